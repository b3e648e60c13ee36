"""What the robot sees."""

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from tidemap.demo import plan
from tidemap.demo.robot import FLICKER, INTERVAL_S, SHADOW, Robot, RobotObservation
from tidemap.demo.story import planted
from tidemap.demo.world import World

START = 1_772_409_600.0  # Monday 2026-03-02 00:00 in London
WEEK = (START + INTERVAL_S * np.arange(2016)).tolist()


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot(World(2014))


@pytest.fixture(scope="module")
def week(robot: Robot) -> list[RobotObservation]:
    return robot.observations(WEEK)


def wrong(robot: Robot, observation: RobotObservation) -> np.ndarray:
    """The cells about which an observation errs."""
    truth = robot.world.occupancy(observation.time).ravel()[observation.cell]
    return np.compress(truth != observation.state.astype(bool), observation.cell)


def ever(observations: Sequence[RobotObservation]) -> np.ndarray:
    seen = np.zeros(plan.SHAPE, np.bool_)
    for observation in observations:
        seen.ravel()[observation.cell] = True
    return seen


def test_the_same_time_is_the_same_observation(robot: Robot, week: list[RobotObservation]) -> None:
    again = Robot(World(2014)).observe(week[100].time)
    assert again is not None
    np.testing.assert_array_equal(again.cell, week[100].cell)
    np.testing.assert_array_equal(again.state, week[100].state)


def test_some_rounds_are_missed(week: list[RobotObservation]) -> None:
    assert 0.88 < len(week) / len(WEEK) < 0.96


def test_none_is_missed_while_something_goes_wrong() -> None:
    now = WEEK[-1]
    world = World(2014, planted(START, now))
    spans = [*world.story.door_open, world.story.office_empty]
    rounds = [time for time in WEEK if any(start <= time < stop for start, stop in spans)]
    assert len(rounds) == 3 + 3 + 30
    assert len(Robot(world).observations(rounds)) == len(rounds)


def test_an_observation_has_a_few_thousand_cells_each_once(week: list[RobotObservation]) -> None:
    sizes = [len(observation.cell) for observation in week]
    assert min(sizes) > 1500
    assert max(sizes) <= 5000
    for observation in week[:50]:
        assert (np.diff(observation.cell.astype(np.int64)) > 0).all()
        assert set(np.unique(observation.state)) == {0, 1}


def test_within_a_few_hours_it_has_seen_every_surface_and_all_that_moves(week: list[RobotObservation]) -> None:
    seen = ever(week[:100])
    surface = plan.standing() & binary_dilation(~plan.standing())
    assert seen[plan.moving()].all()
    assert seen[surface].mean() > 0.99
    assert not seen[plan.standing() & ~surface & ~plan.moving()].any()


def test_most_of_the_air_is_never_seen(week: list[RobotObservation]) -> None:
    air = ~plan.standing() & ~plan.moving()
    assert ever(week)[air].mean() < 0.25


def test_something_is_hidden_on_every_round(robot: Robot, week: list[RobotObservation]) -> None:
    moving = np.flatnonzero(plan.moving())
    hidden = [np.setdiff1d(moving, observation.cell) for observation in week[:200]]
    columns = [np.unique(cells // plan.SHAPE[2]) for cells in hidden]
    assert all(len(each) <= SHADOW[0] * SHADOW[1] for each in columns)
    assert sum(len(each) > 0 for each in columns) > 50


def test_the_sensor_errs_now_and_then_and_never_on_what_stands(robot: Robot, week: list[RobotObservation]) -> None:
    errors = np.concatenate([wrong(robot, observation) for observation in week])
    cells, count = np.unique(errors, return_counts=True)
    assert 20 < len(cells) < 300
    assert not plan.standing().ravel()[cells].any()
    assert not plan.moving().ravel()[cells].any()
    assert 0.5 * FLICKER < (count / len(week)).mean() < 1.2 * FLICKER


def test_no_errors_touch_one_another(robot: Robot, week: list[RobotObservation]) -> None:
    erring = np.zeros(plan.SHAPE, np.bool_)
    erring.ravel()[np.concatenate([wrong(robot, observation) for observation in week])] = True
    for axis in range(3):
        assert not (erring & np.roll(erring, 1, axis)).any()

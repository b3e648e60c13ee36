"""What the robot sees."""

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from tidemap.demo import plan
from tidemap.demo.robot import FLICKER, INTERVAL_S, SHADOW, Look, Robot
from tidemap.demo.story import planted
from tidemap.demo.world import World

START = 1_772_409_600.0  # Monday 2026-03-02 00:00 in London
WEEK = (START + INTERVAL_S * np.arange(2016)).tolist()


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot(World(2014))


@pytest.fixture(scope="module")
def week(robot: Robot) -> list[Look]:
    return robot.looks(WEEK)


def wrong(robot: Robot, look: Look) -> np.ndarray:
    """The cells about which a look errs."""
    truth = robot.world.occupancy(look.time).ravel()[look.cell]
    return np.compress(truth != look.state.astype(bool), look.cell)


def ever(looks: Sequence[Look]) -> np.ndarray:
    seen = np.zeros(plan.SHAPE, np.bool_)
    for look in looks:
        seen.ravel()[look.cell] = True
    return seen


def test_the_same_time_is_the_same_look(robot: Robot, week: list[Look]) -> None:
    again = Robot(World(2014)).look(week[100].time)
    assert again is not None
    np.testing.assert_array_equal(again.cell, week[100].cell)
    np.testing.assert_array_equal(again.state, week[100].state)


def test_some_rounds_are_missed(week: list[Look]) -> None:
    assert 0.88 < len(week) / len(WEEK) < 0.96


def test_none_is_missed_while_something_goes_wrong() -> None:
    now = WEEK[-1]
    world = World(2014, planted(START, now))
    spans = [*world.story.door_open, world.story.office_empty]
    rounds = [time for time in WEEK if any(start <= time < stop for start, stop in spans)]
    assert len(rounds) == 3 + 3 + 30
    assert len(Robot(world).looks(rounds)) == len(rounds)


def test_a_look_has_a_few_thousand_cells_each_once(week: list[Look]) -> None:
    sizes = [len(look.cell) for look in week]
    assert min(sizes) > 1500
    assert max(sizes) <= 5000
    for look in week[:50]:
        assert (np.diff(look.cell.astype(np.int64)) > 0).all()
        assert set(np.unique(look.state)) == {0, 1}


def test_within_a_few_hours_it_has_seen_every_surface_and_all_that_moves(week: list[Look]) -> None:
    seen = ever(week[:100])
    surface = plan.standing() & binary_dilation(~plan.standing())
    assert seen[plan.moving()].all()
    assert seen[surface].mean() > 0.99
    assert not seen[plan.standing() & ~surface & ~plan.moving()].any()


def test_most_of_the_air_is_never_seen(week: list[Look]) -> None:
    air = ~plan.standing() & ~plan.moving()
    assert ever(week)[air].mean() < 0.25


def test_something_is_hidden_on_every_round(robot: Robot, week: list[Look]) -> None:
    moving = np.flatnonzero(plan.moving())
    hidden = [np.setdiff1d(moving, look.cell) for look in week[:200]]
    columns = [np.unique(cells // plan.SHAPE[2]) for cells in hidden]
    assert all(len(each) <= SHADOW[0] * SHADOW[1] for each in columns)
    assert sum(len(each) > 0 for each in columns) > 50


def test_the_sensor_errs_now_and_then_and_never_on_what_stands(robot: Robot, week: list[Look]) -> None:
    errors = np.concatenate([wrong(robot, look) for look in week])
    cells, count = np.unique(errors, return_counts=True)
    assert 20 < len(cells) < 300
    assert not plan.standing().ravel()[cells].any()
    assert not plan.moving().ravel()[cells].any()
    assert 0.5 * FLICKER < (count / len(week)).mean() < 1.2 * FLICKER


def test_no_errors_touch_one_another(robot: Robot, week: list[Look]) -> None:
    erring = np.zeros(plan.SHAPE, np.bool_)
    erring.ravel()[np.concatenate([wrong(robot, look) for look in week])] = True
    for axis in range(3):
        assert not (erring & np.roll(erring, 1, axis)).any()

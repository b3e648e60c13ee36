"""The simulated building: a pure function of seed and time, with the rhythms it is meant to have."""

from datetime import date, datetime
from zoneinfo import ZoneInfo

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tidemap.demo import plan
from tidemap.demo.chance import draw, draws, mix
from tidemap.demo.civil import DAY_S, FRIDAY, TUESDAY, last, moment, unix
from tidemap.demo.story import Story, planted
from tidemap.demo.world import World

LONDON = ZoneInfo("Europe/London")
MONDAY_2 = datetime(2026, 3, 2, tzinfo=LONDON)
WORLD = World(2014)
times = st.floats(1.6e9, 2.0e9)


def at(day: int, hour: int, minute: int = 0) -> float:
    """Unix seconds of a local time in March 2026; the 2nd is a Monday."""
    return datetime(2026, 3, day, hour, minute, tzinfo=LONDON).timestamp()


def share(name: str, stamps: list[float]) -> float:
    return float(np.mean([WORLD.states(time)[name] for time in stamps]))


@given(times)
def test_the_same_time_is_the_same_building_in_any_order(time: float) -> None:
    first = World(7).occupancy(time)
    other = World(7)
    other.occupancy(time + 12345)
    np.testing.assert_array_equal(first, other.occupancy(time))


@given(times)
def test_what_stands_stands_and_what_moves_stays_in_its_places(time: float) -> None:
    cells = WORLD.occupancy(time)
    assert cells.shape == plan.SHAPE
    assert cells[plan.standing()].all()
    assert not (cells & ~plan.standing() & ~plan.moving()).any()


@given(times)
def test_a_door_is_either_open_or_closed(time: float) -> None:
    cells, states = WORLD.occupancy(time), WORLD.states(time)
    for door, name in ((plan.MAIN_DOOR, "main-door"), (plan.OFFICE_DOOR, "office-door")):
        assert cells[door.open].all() == states[name]
        assert cells[door.closed].all() != states[name]


@given(times)
def test_the_places_say_what_the_grid_shows(time: float) -> None:
    cells, states = WORLD.occupancy(time), WORLD.states(time)
    for seats, name in ((plan.OFFICE_SEATS, "office-occupied"), (plan.LAB_SEATS, "lab-occupied")):
        heads = [cells[seat.person()[-1]].all() for seat in seats]
        assert any(heads) == states[name]


def test_seeds_differ() -> None:
    stamps = [at(2, 8) + 300 * i for i in range(60)]
    assert any((World(1).occupancy(time) != World(2).occupancy(time)).any() for time in stamps)


def test_days_have_a_rhythm() -> None:
    for day in (2, 3, 4, 5, 6):
        assert share("office-occupied", [at(day, 11, minute) for minute in range(0, 60, 5)]) == 1
        assert share("office-door", [at(day, 15, minute) for minute in range(0, 60, 5)]) == 1
        for name in WORLD.states(at(day, 3)):
            assert share(name, [at(day, 3, minute) for minute in range(0, 60, 5)]) == 0


def test_weekends_are_quiet_and_the_lab_works_on_saturdays() -> None:
    sundays = [at(day, hour) for day in (1, 8, 15, 22) for hour in range(24)]
    saturdays = [at(day, 12, 40) for day in (7, 14, 21, 28)]
    assert all(share(name, sundays) == 0 for name in WORLD.states(0))
    assert share("office-occupied", saturdays) == 0
    assert share("lab-occupied", saturdays) >= 0.5


def test_the_weekly_meeting_takes_place_every_tuesday_at_ten() -> None:
    tuesdays = [at(day, 10, minute) for day in (3, 10, 17, 24) for minute in range(0, 60, 10)]
    assert {moment(time).weekday for time in tuesdays} == {TUESDAY}
    assert share("meeting-room", tuesdays) == 1
    assert 0.1 < share("meeting-room", [at(day, 14, 20) for day in range(1, 32)]) < 0.7


def test_people_live_by_local_time_when_the_clocks_change() -> None:
    before, after = [at(27, 8, 45)], [at(30, 8, 45)]
    assert (after[0] - before[0]) % DAY_S == DAY_S - 3600
    assert share("office-door", before) == share("office-door", after) == 1
    assert share("office-door", [at(30, 6, 45)]) == 0


def test_the_plant_moves_once() -> None:
    world = World(1, Story(plant_moves=at(10, 12)))
    first, later = plan.PLANT_FIRST[0], plan.PLANT_LATER[0]
    for time, where, absent in ((at(10, 11, 59), first, later), (at(10, 12), later, first)):
        cells = world.occupancy(time)
        assert cells[where].all()
        assert not cells[absent].any()


def test_empty_chairs_wander_within_a_week_and_not_within_a_day() -> None:
    stool = plan.KITCHEN_SEATS[2]
    shifts = []
    for day in range(2, 30):
        cells = WORLD.occupancy(at(day, 4))
        np.testing.assert_array_equal(cells, WORLD.occupancy(at(day, 5)))
        shifts.append(next(shift for shift in plan.SHIFTS if cells[stool.chair(shift)[0]].all()))
    assert set(shifts) == {-1, 0, 1}


@pytest.mark.parametrize("hour", [1, 9, 14, 18, 23])
@pytest.mark.parametrize("day", range(8, 15))
def test_the_story_lies_in_the_last_nights_and_the_last_week(day: int, hour: int) -> None:
    now = at(day, hour)
    story = planted(now - 21 * DAY_S, now)
    for start, stop in story.door_open:
        assert now - 3 * DAY_S < start < stop <= now
        assert moment(start).hour == pytest.approx(2 + 1 / 6)
        assert moment(stop).hour == pytest.approx(2 + 5 / 12)
    start, stop = story.office_empty
    assert now - 7.5 * DAY_S < start < stop <= now
    assert moment(start).weekday == FRIDAY
    assert now - 21 * DAY_S < story.plant_moves < now - 14 * DAY_S


def test_the_planted_anomalies_happen() -> None:
    now = at(9, 9)
    world = World(2014, planted(now - 21 * DAY_S, now))
    for night in world.story.door_open:
        assert world.states(night[0])["office-door"]
        assert not world.states(night[0] - 300)["office-door"]
        assert not world.states(night[1])["office-door"]
    afternoon = np.arange(*world.story.office_empty, 300.0)
    assert not any(world.states(time)["office-occupied"] for time in afternoon)
    assert all(WORLD.states(time)["office-occupied"] for time in afternoon)


def test_local_hours_that_are_over() -> None:
    assert last(2, 3, at(9, 3)) == (at(9, 2), at(9, 3))
    assert last(2, 3, at(9, 3) - 1) == (at(8, 2), at(8, 3))
    assert last(14, 16, at(9, 9), FRIDAY) == (at(6, 14), at(6, 16))


@given(st.integers(date(2000, 1, 1).toordinal(), date(2040, 1, 1).toordinal()), st.integers(3, 23))
def test_civil_time_goes_there_and_back(day: int, hour: int) -> None:
    back = moment(unix(day, hour))
    assert (back.day, back.hour, back.weekday) == (day, hour, date.fromordinal(day).weekday())


@given(st.lists(st.integers(0, 2**63), min_size=1, max_size=5), st.integers(-(2**70), 2**70))
def test_chance_is_a_function_of_its_key_alone(items: list[int], key: int) -> None:
    assert draws(np.array(items, np.uint64), key).tolist() == [draw(key, item) for item in items]
    assert mix(key, 1) != mix(1, key) or key % 2**64 == 1


def test_chance_is_uniform() -> None:
    numbers = draws(np.arange(100_000, dtype=np.uint64), 5)
    assert np.histogram(numbers, 10, (0, 1))[0].std() < 200
    assert abs(np.corrcoef(numbers[:-1], numbers[1:])[0, 1]) < 0.01

"""What stands still can be abnormal: a door that was left open is noticed while it stands open."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from tests.api.house import DAY, HOUR, NOW, Api, done, open_house
from tests.support.databases import Databases
from tidemap.events.messages import EventMessage
from tidemap.schemas.common import parse_time
from tidemap.services.detect import search
from tidemap.services.standing import judge_standing, standing_locations

MINUTE = 60.0
FRIDAY = NOW + 4 * DAY
"""Midnight."""


@pytest.fixture
def house(databases: Databases, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Api]:
    """A site of its own, on Friday evening."""
    with databases.migrated() as url, open_house(tmp_path_factory.mktemp("house"), url) as house:
        house.clock.now = FRIDAY + 23 * HOUR
        yield house


def door(house: Api) -> str:
    """A door that is open from 8 to 20 o'clock on weekdays, and speaks when it changes; six weeks of it."""
    form = {"interval_s": MINUTE, "estimator": "calendar", "order": 3, "missing": "hold", "hold_s": 4 * DAY}
    name = house.location(**form)
    days = [FRIDAY - d * DAY for d in range(42, 0, -1) if (4 - d) % 7 < 5]
    house.observe(name, [day + hour * HOUR for day in days for hour in (8, 20)], [1, 0] * len(days))
    house.update(name)
    return name


def look(house: Api, now: float) -> None:
    """What the watcher does, at a time."""
    house.clock.now = now
    for location in standing_locations(house.ctx):
        while judge_standing(house.ctx, location):
            pass


def hours(events: list[dict[str, str]]) -> list[tuple[float, float]]:
    """When they start and stop, in hours since the midnight before Friday."""
    times = [[(parse_time(event[end]) - FRIDAY) / HOUR for end in ("start", "stop")] for event in events]
    return [(start, stop) for start, stop in times]


def bounds(house: Api, name: str) -> list[tuple[float, float]]:
    """Of the stored events."""
    found = done(house.get(f"/locations/{name}/anomalies"))["items"]
    return hours(found)


def detected(house: Api, name: str) -> list[tuple[float, float]]:
    """The same of those that a search finds."""
    found = done(
        house.post(f"/locations/{name}/anomalies/detect", {"start": FRIDAY + 22 * HOUR, "stop": house.clock.now})
    )
    return hours(found["items"])


def test_case_6_a_door_that_stands_open_at_night(house: Api, heard: list[EventMessage]) -> None:
    name = door(house)
    look(house, FRIDAY + 22 * HOUR)
    assert bounds(house, name) == []
    house.clock.now = FRIDAY + 23 * HOUR
    house.observe(name, [FRIDAY + 23 * HOUR], [1])
    look(house, FRIDAY + 23 * HOUR + 10 * MINUTE)
    assert np.allclose(bounds(house, name), [(23, 23 + 10 / 60)])
    look(house, FRIDAY + 33 * HOUR)
    assert bounds(house, name) == [(23, 33)]
    house.observe(name, [FRIDAY + 33 * HOUR], [0])
    count = len(heard)
    look(house, FRIDAY + 36 * HOUR)
    assert bounds(house, name) == detected(house, name) == [(23, 33)]
    assert len(heard) == count, "nothing has changed since"
    assert [message.wire()["update"] for message in heard] == [False, True, True]
    assert len({message.id for message in heard}) == 1
    at = {"start": FRIDAY + 22 * HOUR, "stop": FRIDAY + 34 * HOUR, "step": HOUR}
    assert done(house.get(f"/locations/{name}/series", params=at))["observed"] == [0, *[1] * 10, 0]


def test_what_was_usual_becomes_surprising_while_nobody_says_anything(house: Api, heard: list[EventMessage]) -> None:
    name = door(house)
    house.observe(name, [FRIDAY + 8 * HOUR], [1])
    look(house, FRIDAY + 19 * HOUR)
    assert heard == []
    look(house, FRIDAY + 23 * HOUR)
    ((start, stop),) = bounds(house, name)
    assert 19.9 < start < 21
    assert (stop, len(heard)) == (23, 1)


def test_a_reading_that_comes_late_ends_what_was_held(house: Api) -> None:
    name = door(house)
    house.observe(name, [FRIDAY + 23 * HOUR], [1])
    look(house, FRIDAY + 30 * HOUR)
    assert bounds(house, name) == [(23, 30)]
    house.observe(name, [FRIDAY + 23.5 * HOUR], [0])
    look(house, FRIDAY + 31 * HOUR)
    assert bounds(house, name) == detected(house, name) == [(23, 23.5)]


def test_a_late_reading_of_the_sample_in_which_an_event_began_ends_it_there(house: Api) -> None:
    """The first sample was published, and stays."""
    name = door(house)
    house.observe(name, [FRIDAY + 23 * HOUR + 5], [1])
    look(house, FRIDAY + 30 * HOUR)
    assert bounds(house, name) == [(23, 30)]
    house.observe(name, [FRIDAY + 23 * HOUR + 40], [0])
    look(house, FRIDAY + 31 * HOUR)
    assert np.allclose(bounds(house, name), [(23, 23 + 1 / 60)])
    assert detected(house, name) == []


def test_a_late_reading_ends_an_event_that_began_after_it(house: Api, heard: list[EventMessage]) -> None:
    """What was held alone made it."""
    name = door(house)
    house.observe(name, [FRIDAY + 8 * HOUR], [1])
    look(house, FRIDAY + 30 * HOUR)
    ((start, stop),) = bounds(house, name)
    assert (start > 19.9, stop) == (True, 30)
    house.observe(name, [FRIDAY + 19 * HOUR], [0])
    look(house, FRIDAY + 31 * HOUR)
    assert np.allclose(bounds(house, name), [(start, start + 1 / 60)])
    assert detected(house, name) == []
    assert len(heard) == 2
    assert heard[-1].data["update"]
    assert np.isclose(parse_time(heard[-1].wire()["stop"]), FRIDAY + start * HOUR + MINUTE)


def test_late_readings_before_an_event_and_in_it_end_it_at_the_second(house: Api) -> None:
    name = door(house)
    house.observe(name, [FRIDAY + 23 * HOUR], [1])
    look(house, FRIDAY + 30 * HOUR)
    house.observe(name, [FRIDAY + 22 * HOUR, FRIDAY + 23.5 * HOUR], [0, 0])
    look(house, FRIDAY + 31 * HOUR)
    assert bounds(house, name) == detected(house, name) == [(23, 23.5)]


def test_a_late_reading_before_an_event_that_was_read_leaves_it(house: Api, heard: list[EventMessage]) -> None:
    name = door(house)
    house.observe(name, [FRIDAY + 23 * HOUR], [1])
    look(house, FRIDAY + 30 * HOUR)
    count = len(heard)
    house.observe(name, [FRIDAY + 22 * HOUR], [0])
    look(house, FRIDAY + 30 * HOUR + 30)
    assert bounds(house, name) == [(23, 30)]
    assert len(heard) == count


def test_an_event_lasts_while_one_of_its_cells_is_as_it_was_seen(house: Api) -> None:
    """Two cells were occupied that never are, side by side; a late look has one of them free, a later one both."""
    name = house.lab(interval_s=MINUTE, estimator="static", missing="hold", hold_s=4 * DAY)
    house.look(name, *[(FRIDAY + n * HOUR, [], [0, 1]) for n in range(22)])
    house.update(name)
    house.look(name, (FRIDAY + 23 * HOUR, [0, 1], []))
    look(house, FRIDAY + 30 * HOUR)
    assert bounds(house, name) == [(23, 30)]
    house.look(name, (FRIDAY + 22 * HOUR, [], [0, 1]), (FRIDAY + 24 * HOUR, [], [0]))
    look(house, FRIDAY + 30 * HOUR + 30)
    assert bounds(house, name) == [(23, 30)]
    house.look(name, (FRIDAY + 22 * HOUR, [], [0, 1]), (FRIDAY + 25 * HOUR, [], [0, 1]))
    look(house, FRIDAY + 31 * HOUR)
    assert bounds(house, name) == detected(house, name) == [(23, 25)]


def test_what_was_told_stays_where_a_later_model_finds_it_usual(house: Api, heard: list[EventMessage]) -> None:
    """The door says again that it is open, after an update that learned so: it is the same incident, and as long."""
    name = door(house)
    house.observe(name, [FRIDAY + 23 * HOUR], [1])
    look(house, FRIDAY + 30 * HOUR)
    assert bounds(house, name) == [(23, 30)]
    done(house.patch(f"/locations/{name}", {"confidence": 0.999999}))
    house.update(name)
    count = len(heard)
    house.observe(name, [FRIDAY + 26 * HOUR], [1])
    look(house, FRIDAY + 30 * HOUR + 30)
    assert bounds(house, name) == [(23, 30)]
    assert len(heard) == count, "nothing has changed"
    # By what is measured it ends all the same.
    house.observe(name, [FRIDAY + 28 * HOUR], [0])
    look(house, FRIDAY + 31 * HOUR)
    assert bounds(house, name) == [(23, 28)]


def test_what_is_left_is_judged_at_once_where_nothing_is_held(house: Api, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing was read for days; and a look that is to end does, whatever there is to judge."""
    name = door(house)
    monkeypatch.setattr("tidemap.services.standing.MAX_SAMPLES", 100)
    done(house.patch(f"/locations/{name}", {"hold_s": HOUR}))
    house.observe(name, [FRIDAY + 20 * HOUR], [0])
    house.clock.now = FRIDAY + 90 * HOUR
    (location,) = standing_locations(house.ctx)
    assert judge_standing(house.ctx, location)
    assert not judge_standing(house.ctx, location)
    (location,) = standing_locations(house.ctx)
    assert location.judged_to == house.clock.now

    def leave() -> None:
        raise InterruptedError

    with pytest.raises(InterruptedError):
        judge_standing(house.ctx, location, leave)


def test_a_state_stands_no_longer_than_hold_s(house: Api) -> None:
    name = door(house)
    done(house.patch(f"/locations/{name}", {"hold_s": HOUR}))
    house.observe(name, [FRIDAY + 23 * HOUR], [1])
    look(house, FRIDAY + 30 * HOUR)
    assert bounds(house, name) == detected(house, name)
    assert np.allclose(bounds(house, name), [(23, 24 + 1 / 60)])


def test_many_samples_are_judged_some_at_a_time(house: Api, monkeypatch: pytest.MonkeyPatch) -> None:
    name = door(house)
    monkeypatch.setattr("tidemap.services.standing.MAX_SAMPLES", 7)
    house.observe(name, [FRIDAY + 23 * HOUR], [1])
    look(house, FRIDAY + 25 * HOUR)
    assert bounds(house, name) == [(23, 25)]


def test_a_post_that_comes_while_it_is_judged_is_not_missed(house: Api, monkeypatch: pytest.MonkeyPatch) -> None:
    """What was found is out of date then; a post of later does not matter."""
    name = door(house)
    house.observe(name, [FRIDAY + 23 * HOUR], [1])
    house.clock.now = FRIDAY + 26 * HOUR
    (location,) = standing_locations(house.ctx)

    def searched(*arguments: Any) -> Any:
        found = search(*arguments)
        house.observe(name, *posted)
        return found

    monkeypatch.setattr("tidemap.services.standing.search", searched)
    posted: tuple[list[float], list[int]] = [FRIDAY + 24 * HOUR], [0]
    judge_standing(house.ctx, location)
    assert np.allclose(bounds(house, name), [(23, 23 + 1 / 60)])
    posted = [FRIDAY + 26 * HOUR], [0]
    judge_standing(house.ctx, location)
    assert bounds(house, name) == [(23, 24)]

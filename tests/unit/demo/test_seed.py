"""The plan of the seeding, its progress, and the guard around other people's locations."""

from datetime import datetime, timedelta
from zoneinfo import ZoneInfo

import pytest

from tidemap.demo.civil import DAY_S
from tidemap.demo.locations import FORMS, NotTheDemoError, check
from tidemap.demo.seed import chunks, phases, rounds
from tidemap.demo.story import planted
from tidemap.schemas.locations import Grid, Location, LocationForm

MONDAY = datetime(2026, 3, 2, tzinfo=ZoneInfo("Europe/London"))


@pytest.mark.parametrize("hours", range(0, 168, 7))
def test_the_first_model_sees_two_weeks_and_judges_what_is_planted(hours: int) -> None:
    now = (MONDAY + timedelta(hours=hours)).timestamp()
    start, judged = phases(now, None)
    story = planted(start, now)
    assert judged - start >= 14 * DAY_S
    assert now - 22 * DAY_S < start <= now - 21 * DAY_S
    assert now - 8 * DAY_S < judged <= now - 3 * DAY_S
    assert judged < story.office_empty[0]
    assert all(judged < night[0] for night in story.door_open)


def test_a_building_that_is_known_keeps_its_beginning() -> None:
    assert phases(MONDAY.timestamp(), 5.0)[0] == 5.0


def test_chunks_lose_nothing() -> None:
    assert [list(part) for part in chunks(list(range(7)), 3)] == [[0, 1, 2], [3, 4, 5], [6]]
    assert not list(chunks([], 3))


def test_rounds_are_multiples_of_the_interval() -> None:
    assert rounds(1000.0, 2000.0).tolist() == [1200.0, 1500.0, 1800.0]
    assert not rounds(1800.0, 1800.0).size


@pytest.mark.parametrize("name", FORMS)
def test_the_locations_are_sound(name: str) -> None:
    form = LocationForm(name=name, **FORMS[name])
    assert form.interval_s == 300
    assert form.time_zone == "Europe/London"


def known(name: str, **changes: object) -> Location:
    form = LocationForm(name=name, **FORMS[name]).model_dump()
    facts = {"shape": [1], "observations": 0, "revision": 0, "open_anomalies": 0, "created_at": 0.0}
    absent = dict.fromkeys(("first_time", "last_time", "updated_at", "accuracy"))
    return Location.model_validate(form | facts | absent | changes)


@pytest.mark.parametrize("name", FORMS)
def test_our_own_locations_are_recognised_whatever_was_set_since(name: str) -> None:
    check(known(name, confidence=0.6, order=3, min_cells=7), FORMS[name])


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("office-door", {"interval_s": 60.0}),
        ("office-door", {"epoch": 100.0}),
        ("building", {"grid": Grid(resolution_m=0.1, shape=[60, 40, 12])}),
        ("building", {"kind": "state", "grid": None}),
    ],
)
def test_other_peoples_locations_are_left_alone(name: str, changes: dict[str, object]) -> None:
    with pytest.raises(NotTheDemoError, match=name):
        check(known(name, **changes), FORMS[name])

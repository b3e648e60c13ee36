"""The plan of the seeding, its progress, and the guard around other people's locations."""

import io
from datetime import datetime, timedelta
from zoneinfo import ZoneInfo

import pytest

from tidemap.demo.civil import DAY_S
from tidemap.demo.locations import FORMS, NotTheDemoError, check
from tidemap.demo.seed import chunks, phases, rounds
from tidemap.demo.story import planted
from tidemap.progress import Bar, Lines, ShownProgress
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
    check(known(name, confidence=0.6, order=3, min_cells=7))


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
        check(known(name, **changes))


class Terminal(io.StringIO):
    """A stream that claims to be a terminal."""

    def isatty(self) -> bool:
        return True


def test_progress_is_a_bar_on_a_terminal_and_lines_elsewhere() -> None:
    terminal, log = Terminal(), io.StringIO()
    for stream, shown in ((terminal, Bar), (log, Lines)):
        task = ShownProgress(stream).task("History", 4)
        assert isinstance(task, shown)
        with task as step:
            step(4)
    assert "History: 100%" in terminal.getvalue()
    assert "\r" not in log.getvalue()
    assert log.getvalue().splitlines()[0] == "History: ..."
    assert log.getvalue().splitlines()[-1].startswith("History: done after")


def test_lines_say_how_far_it_is_now_and_then(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([0.0, 0.0, 1.0, 6.0, 6.0, 7.0, 8.0, 8.0])
    monkeypatch.setattr("tidemap.progress.time.monotonic", lambda: next(clock))
    log = io.StringIO()
    with Lines("History", 4, log) as step:
        step(1)
        step(1)
        step(1)
    assert log.getvalue().splitlines()[1:-1] == ["History: 50 % of 4"]


def test_a_task_that_breaks_says_so() -> None:
    log = io.StringIO()
    with pytest.raises(RuntimeError), Lines("History", 4, log):
        raise RuntimeError
    assert "History: broken off after" in log.getvalue()

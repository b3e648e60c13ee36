"""A sensor that says it is unavailable: what was held ends, in every answer alike, on SQLite and PostgreSQL."""

import json
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pytest

from tests.support.contexts import Clock, compact_now, make_location, opened, refit
from tidemap.formats.arrow import write
from tidemap.formats.registry import Body
from tidemap.history.history import FREE, OCCUPIED, UNOBSERVED
from tidemap.media_types import ARROW, JSON
from tidemap.services.anomalies import EventQuery, list_events
from tidemap.services.context import Context
from tidemap.services.deletion import Deletion, delete_observations
from tidemap.services.detect import DetectQuery, detect
from tidemap.services.locations import get_location
from tidemap.services.observe import observe
from tidemap.services.posts import Observed, Post
from tidemap.services.series import SeriesQuery, series
from tidemap.services.standing import judge_standing, standing_locations
from tidemap.services.state import StateQuery, state_at
from tidemap.services.verify import verify
from tidemap.settings import DAY_S

HOUR = 3600.0
FRIDAY = 1_700_179_200.0
"""Midnight."""
NIGHT = FRIDAY + 23 * HOUR
WAYS = pytest.mark.parametrize("compacted", [False, True])


@pytest.fixture
def clock() -> Clock:
    return Clock(FRIDAY + 20 * HOUR)


@pytest.fixture
def ctx(database_url: str, clock: Clock) -> Iterator[Context]:
    with opened(database_url, clock) as context:
        yield context
        verify(database_url, lambda finding: pytest.fail(str(finding)))


def say(ctx: Context, time: Sequence[float], state: Sequence[int | None], **post: Any) -> Observed:
    body = json.dumps({"time": list(time), "state": list(state)}).encode()
    return observe(ctx, "door", Post(Body(body, JSON), **post))


def door(ctx: Context, **form: Any) -> None:
    """Open from 8 to 20 o'clock, and it speaks when it changes; six weeks of it, to Friday evening."""
    how = {"estimator": "calendar", "order": 3, "missing": "hold", "hold_s": 4 * DAY_S, **form}
    make_location(ctx, "door", **how)
    days = [FRIDAY - d * DAY_S for d in range(42, -1, -1)]
    say(ctx, [day + hour * HOUR for day in days for hour in (8, 20)], [1, 0] * len(days))
    refit(ctx, "door")


def look(ctx: Context, clock: Clock, now: float) -> None:
    """What the watcher does, at a time."""
    clock.now = now
    for location in standing_locations(ctx):
        while judge_standing(ctx, location):
            pass


def shown(ctx: Context, start: float = NIGHT - HOUR, stop: float = NIGHT + 12 * HOUR) -> list[int]:
    """What `series` observed, every hour."""
    return list(series(ctx, "door", SeriesQuery(start=start, stop=stop, step=HOUR)).observed.tolist())


def hours(ctx: Context, now: float) -> list[tuple[float, float]]:
    """The stored events, in hours since Friday; a search finds the same."""
    stored = [((e.start - FRIDAY) / HOUR, (e.stop - FRIDAY) / HOUR) for e in list_events(ctx, EventQuery())]
    found = detect(ctx, "door", DetectQuery(FRIDAY + 12 * HOUR, now))[0]
    assert [((e.start - FRIDAY) / HOUR, (e.stop - FRIDAY) / HOUR) for e in found] == stored
    return stored


@WAYS
def test_what_is_held_ends_in_every_answer(ctx: Context, clock: Clock, compacted: bool) -> None:
    door(ctx)
    clock.now = NIGHT
    say(ctx, [NIGHT], [1])
    look(ctx, clock, NIGHT + HOUR)
    assert hours(ctx, clock.now) == [(23, 24)]
    clock.now = NIGHT + 3 * HOUR
    assert say(ctx, [NIGHT + 3 * HOUR], [None]).accepted == 1
    if compacted:
        compact_now(ctx, "door")
    look(ctx, clock, NIGHT + 7 * HOUR)
    assert hours(ctx, clock.now) == [(23, 26)]
    say(ctx, [NIGHT + 7 * HOUR], [0])
    look(ctx, clock, NIGHT + 8 * HOUR)
    assert hours(ctx, clock.now) == [(23, 26)]
    assert shown(ctx, stop=NIGHT + 8 * HOUR) == [FREE] + [OCCUPIED] * 3 + [UNOBSERVED] * 4 + [FREE]


@WAYS
def test_a_late_word_ends_what_was_held_since(ctx: Context, clock: Clock, compacted: bool) -> None:
    door(ctx)
    clock.now = NIGHT
    say(ctx, [NIGHT], [1])
    look(ctx, clock, NIGHT + 6 * HOUR)
    assert hours(ctx, clock.now) == [(23, 29)]
    if compacted:
        compact_now(ctx, "door")
    say(ctx, [NIGHT + 2 * HOUR], [None])
    look(ctx, clock, NIGHT + 7 * HOUR)
    assert hours(ctx, clock.now) == [(23, 25)]


def test_a_prediction_trusts_what_is_held_no_longer(ctx: Context, clock: Clock) -> None:
    """`state` given the readings: as if the reading had been held until then, and not until now."""
    door(ctx)
    clock.now = now = NIGHT + 5 * HOUR
    say(ctx, [NIGHT], [1])

    def p(**how: Any) -> float:
        asked = StateQuery(now + HOUR / 2, given="observations", as_of=now, **how)
        return float(state_at(ctx, "door", asked).probability[0])

    standing = p()
    say(ctx, [NIGHT + HOUR], [None])
    ended = p()
    rhythm = float(state_at(ctx, "door", StateQuery(now + HOUR / 2)).probability[0])
    assert abs(ended - rhythm) < abs(standing - rhythm)
    say(ctx, [now - 60], [1])
    assert abs(p() - rhythm) > abs(ended - rhythm)


@WAYS
def test_what_was_said_can_be_deleted_and_is_forgotten(ctx: Context, clock: Clock, compacted: bool) -> None:
    door(ctx, retention=20 * DAY_S)
    clock.now = NIGHT + 12 * HOUR
    say(ctx, [NIGHT], [1])
    say(ctx, [NIGHT + HOUR], [None], source="other")
    before = shown(ctx)
    assert before == [FREE, OCCUPIED] + [UNOBSERVED] * 11
    if compacted:
        compact_now(ctx, "door")
    assert delete_observations(ctx, "door", Deletion(NIGHT + HOUR, NIGHT + 2 * HOUR, "other")) == 1
    assert shown(ctx) == [FREE] + [OCCUPIED] * 12
    assert get_location(ctx, "door").last_time == NIGHT
    say(ctx, [NIGHT + HOUR], [None])
    clock.now += 30 * DAY_S
    say(ctx, [clock.now], [None])
    refit(ctx, "door")
    assert (get_location(ctx, "door").first_time, get_location(ctx, "door").last_time) == (clock.now, clock.now)


def test_cells_of_a_grid_become_unavailable_each_for_itself(ctx: Context) -> None:
    """By Arrow with nulls, by floats with NaN, and by JSON."""
    make_location(ctx, "lab", (2, 2), missing="hold", hold_s=HOUR)
    cells = np.arange(4, dtype=np.uint32)
    whole = {"time": np.full(4, FRIDAY), "cell": cells, "state": np.array([1, 0, 1, 0], np.uint8)}
    observe(ctx, "lab", Post(Body(bytes(write({}, whole)), ARROW)))
    gone = {"time": np.full(2, FRIDAY + 120), "cell": cells[:2], "state": np.array([np.nan, 1.0], np.float32)}
    observe(ctx, "lab", Post(Body(bytes(write({}, gone)), ARROW)))
    look_ = {"observations": [{"time": FRIDAY + 240, "free": [2], "unavailable": [[1, 1]]}]}
    observe(ctx, "lab", Post(Body(json.dumps(look_).encode(), JSON)))
    found = [series(ctx, "lab", SeriesQuery(cell, FRIDAY, FRIDAY + 360, 60.0)).observed.tolist() for cell in range(4)]
    assert found == [[1, 1, 2, 2, 2, 2], [0, 0, 1, 1, 1, 1], [1, 1, 1, 1, 0, 0], [0, 0, 0, 0, 2, 2]]

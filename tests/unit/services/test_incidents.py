"""Events that grow: whatever the order and the cut of the posts, they are what a search of the history finds."""

from typing import Any

import numpy as np
import pytest

from tests.support.contexts import compact_now, make_location, post_rows, refit
from tidemap.services.anomalies import Anomaly, EventQuery, get_event, list_events
from tidemap.services.context import Context
from tidemap.services.detect import DetectQuery, detect

MINUTE = 60.0
SIDE = 6
Row = tuple[float, int, int]


def make_room(ctx: Context, **settings: Any) -> None:
    """A grid whose left half is always free and whose right half is always occupied."""
    make_location(ctx, "room", (SIDE, SIDE), estimator="static", **settings)
    post_rows(ctx, "room", [(MINUTE * n, c, int(c % SIDE >= SIDE // 2)) for n in range(30) for c in range(SIDE**2)])
    refit(ctx, "room")


def readings(seed: int) -> list[list[Row]]:
    """Looks of an hour, each at a part of the room, few of them surprising."""
    chance = np.random.default_rng(seed)
    looks = []
    for n in 100 + np.flatnonzero(chance.random(60) < 0.6):
        cells = np.flatnonzero(chance.random(SIDE**2) < 0.7).tolist()
        usual = [int(c % SIDE >= SIDE // 2) for c in cells]
        odd = chance.random(len(cells)) < 0.12
        looks.append([(MINUTE * float(n), c, int(s ^ o)) for c, s, o in zip(cells, usual, odd, strict=True)])
    return looks


def facts(events: list[Anomaly]) -> list[tuple[Any, ...]]:
    """All but the number, and what depends on which of several readings made an event as large as it is."""
    return sorted(
        (event.start, event.stop, event.cells.tolist(), event.bits.tolist(), round(event.surprise, 6))
        for event in events
    )


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    ("shuffled", "compacted", "settings"),
    [
        (False, False, {}),
        (False, True, {}),
        (True, False, {"event_gap_s": 0.0, "min_cells": 2}),
        (True, False, {"event_gap_s": 180.0}),
    ],
)
def test_posts_make_what_a_search_finds(
    ctx: Context, seed: int, shuffled: bool, compacted: bool, settings: dict[str, Any]
) -> None:
    """In any order where the location says how long a gap may be, else in theirs: what is one is not split later."""
    make_room(ctx, **settings)
    looks = readings(seed)
    chance = np.random.default_rng(seed)
    order = chance.permutation(len(looks)) if shuffled else np.arange(len(looks))
    for part in np.array_split(order, len(looks) // 2):
        post_rows(ctx, "room", [row for i in part.tolist() for row in looks[i]])
        if compacted:
            compact_now(ctx, "room")
    stored = list_events(ctx, EventQuery("room"))
    found, _ = detect(ctx, "room", DetectQuery(MINUTE * 100, 1e9))
    assert len(stored) > 1
    assert any(event.parts for event in stored)
    assert facts(stored) == facts(found)
    assert all(get_event(ctx, event.id).id == event.id for event in stored)

"""Ends: a sensor that is unavailable ends what is held, whatever the order and the batches of posts."""

from random import Random

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.truth import measurements_of
from tidemap.history.combining import LATEST
from tidemap.history.erasing import erase_all
from tidemap.history.history import UNOBSERVED
from tidemap.history.measurements import UNAVAILABLE
from tidemap.history.segment import Segment, ends_of, join, merge
from tidemap.history.timebase import TimeBase
from tidemap.storage.blobs import pack_measurements, pack_segment, unpack_measurements, unpack_segment

BASE = TimeBase(0.0, 60.0)
CELLS, SAMPLES, HOLD = 2, 24, 6
Row = tuple[float, int, int]
ROWS = st.lists(
    st.tuples(st.integers(0, 4 * SAMPLES - 1).map(lambda n: 15.0 * n), st.integers(0, CELLS - 1), st.integers(0, 2)),
    max_size=25,
)
quick = settings(max_examples=50)


def merged(rows: list[Row], segment: Segment | None = None) -> Segment:
    return merge(segment or Segment.empty(CELLS, 0), measurements_of(rows), BASE, LATEST)


def packed(segment: Segment) -> bytes:
    """To the last bit: a segment is canonical."""
    return pack_segment(unpack_segment(pack_segment(segment), 0, "test"))


def held(segment: Segment) -> list[list[int]]:
    """What a location with `missing: hold` shows."""
    history = segment.history.ending(*ends_of(segment, BASE))
    return [list(row) for row in history.held(0, SAMPLES, HOLD).states().tolist()]


def expected(rows: list[Row]) -> list[list[int]]:
    """The same, event by event: of one moment what says a state comes last, and of those the occupied one."""
    shown = [[UNOBSERVED] * SAMPLES for _ in range(CELLS)]
    for cell in range(CELLS):
        said = sorted((t, -1 if s == UNAVAILABLE else s) for t, c, s in rows if c == cell)
        state, left = UNOBSERVED, 0
        for n in range(SAMPLES):
            mine = [s for t, s in said if 60.0 * n <= t < 60.0 * n + 60]
            states = [s for s in mine if s >= 0]
            if states:
                state, left = states[-1], HOLD
            elif mine or not left:
                state, left = UNOBSERVED, 0
            else:
                left -= 1
            shown[cell][n] = state
            if mine and mine[-1] < 0:
                left = 0
    return shown


@quick
@given(ROWS, st.randoms(use_true_random=False), st.integers(1, 5), st.booleans())
def test_a_state_is_held_until_its_sensor_is_unavailable(rows: list[Row], chance: Random, size: int, two: bool) -> None:
    whole = merged(rows)
    assert held(whole) == expected(rows)
    shuffled = rows + rows[::3]
    chance.shuffle(shuffled)
    parts = [Segment.empty(CELLS, 0), Segment.empty(CELLS, 0)]
    for i in range(0, len(shuffled), size):
        some = measurements_of(shuffled[i : i + size]).in_order()
        again = unpack_measurements(pack_measurements(some), "test")
        assert (again.time.tolist(), again.state.tolist()) == (some.time.tolist(), some.state.tolist())
        into = i % 2 if two else 0
        parts[into] = unpack_segment(packed(merge(parts[into], again, BASE, LATEST)), 0, "test")
    assert packed(join(parts[0], parts[1], BASE, LATEST)) == packed(whole)


@quick
@given(ROWS, st.integers(0, SAMPLES), st.integers(0, SAMPLES))
def test_what_is_erased_was_never_said(rows: list[Row], first: int, length: int) -> None:
    """Whole samples."""
    start, stop = 60.0 * first, 60.0 * (first + length)
    left, _ = erase_all(merged(rows), lambda time: np.asarray((time >= start) & (time < stop)), BASE)
    rest = [row for row in rows if not start <= row[0] < stop]
    assert packed(left) == packed(merged(rest))
    assert left.is_empty == (not rest)

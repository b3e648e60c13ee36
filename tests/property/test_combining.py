"""Combining: whatever the order and the batches of posts, each `combine` makes the same history of them."""

from collections import defaultdict
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.property.test_segment import BASE, CELLS, NUMBER, ROWS, START, assert_same, quick
from tests.support.truth import Row, measurements_of
from tidemap.history.combining import ANY, LATEST, MAJORITY
from tidemap.history.erasing import erase
from tidemap.history.segment import SEGMENT_SAMPLES, Segment, join, merge, standing
from tidemap.storage.blobs import pack_segment, unpack_segment

COMBINES = pytest.mark.parametrize("combine", [LATEST, ANY, MAJORITY])
MANY = st.lists(ROWS, max_size=40)
Facts = dict[tuple[int, int], tuple[float, int]]


def merged(rows: list[Row], combine: str, segment: Segment | None = None) -> Segment:
    return merge(segment or Segment.empty(CELLS, NUMBER), measurements_of(rows), BASE, combine)


def truth_of(rows: list[Row], combine: str) -> Facts:
    """By (cell, sample) the time that stands and the state, of all measurements at once."""
    seen: dict[tuple[int, int], list[tuple[float, int]]] = defaultdict(list)
    for time, cell, state in rows:
        seen[cell, int(BASE.sample(time))].append((time, state))
    return {key: _standing(readings, combine) for key, readings in seen.items()}


def _standing(readings: list[tuple[float, int]], combine: str) -> tuple[float, int]:
    if combine == LATEST:
        return max(readings)
    if combine == ANY:
        state, time = max((state, time) for time, state in readings)
        return time, state
    states = [state for _, state in readings]
    return max(time for time, _ in readings), int(2 * sum(states) >= len(states))


def facts_of(segment: Segment) -> Facts:
    found = standing(segment, BASE)
    samples = found.samples(BASE).tolist()
    columns = zip(found.cell.tolist(), samples, found.time.tolist(), found.state.tolist(), strict=True)
    return {(cell, sample): (time, state) for cell, sample, time, state in columns}


@COMBINES
@quick
@given(rows=MANY)
def test_a_segment_says_what_all_measurements_say(combine: str, rows: list[Row]) -> None:
    assert facts_of(merged(rows, combine)) == truth_of(rows, combine)


@COMBINES
@quick
@given(rows=MANY, chance=st.randoms(use_true_random=False), size=st.integers(1, 7), store=st.booleans())
def test_any_order_and_split_is_the_same_to_the_last_bit(
    combine: str, rows: list[Row], chance: Random, size: int, store: bool
) -> None:
    shuffled = list(rows)
    chance.shuffle(shuffled)
    segment = Segment.empty(CELLS, NUMBER)
    for i in range(0, len(shuffled), size):
        segment = merged(shuffled[i : i + size], combine, segment)
        if store:
            segment = unpack_segment(pack_segment(segment), NUMBER, "test")
    assert_same(segment, merged(rows, combine))


@COMBINES
@quick
@given(one=MANY, other=MANY)
def test_joined_segments_are_all_that_is_in_both(combine: str, one: list[Row], other: list[Row]) -> None:
    joined = join(merged(one, combine), merged(other, combine), BASE, combine)
    assert_same(joined, merged(one + other, combine))


@COMBINES
@quick
@given(
    rows=MANY,
    later=MANY,
    low=st.integers(-1, 5),
    length=st.sampled_from([0, 1, 3, 4100]),
    off=st.sampled_from([0, 30.0]),
)
def test_erasing_takes_what_stands_on_those_times(
    combine: str, rows: list[Row], later: list[Row], low: int, length: int, off: float
) -> None:
    start = float(BASE.time(START + low)) + off
    stop = start + 60.0 * length
    segment, truth = merged(rows, combine), truth_of(rows, combine)
    left, number = erase(segment, (segment.time >= start) & (segment.time < stop), BASE)
    stays = {key: fact for key, fact in truth.items() if not start <= fact[0] < stop}
    assert facts_of(left) == stays
    assert number == len(truth) - len(stays)
    assert left.time.tolist() == sorted({time for time, _ in stays.values()})
    assert_same(unpack_segment(pack_segment(left), NUMBER, "test"), left)
    if off == 0:
        # Whole samples: as if nothing had ever been measured in them.
        rest = [row for row in rows if not start <= row[0] < stop]
        assert_same(left, merged(rest, combine))
        assert_same(merged(later, combine, left), merged(rest + later, combine))


def test_a_cell_that_was_seen_a_hundred_thousand_times_in_a_sample() -> None:
    time = np.linspace(float(BASE.time(START)), float(BASE.time(START + 1)), 100_000, endpoint=False)
    rows = [(t, 0, int(i % 100 < 51)) for i, t in enumerate(time.tolist())]
    segment = merged(rows[::2], MAJORITY, merged(rows[1::2], MAJORITY))
    assert facts_of(segment) == {(0, START): (time[-1], 1)}
    assert segment.surplus is not None
    assert segment.surplus[0, 0] == 1999
    assert facts_of(merged([(time[-1], 0, 0)] * 2001, MAJORITY, segment)) == {(0, START): (time[-1], 0)}


def test_what_one_measurement_says_takes_no_more_room() -> None:
    rows = [(float(BASE.time(START + n)), cell, n % 2) for n in range(SEGMENT_SAMPLES) for cell in range(CELLS)]
    assert merged(rows, MAJORITY).surplus is None
    assert pack_segment(merged(rows, MAJORITY)) == pack_segment(merged(rows, LATEST))

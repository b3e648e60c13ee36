"""Merging is a set operation: whatever the order, the batches and the repeats, the same measurements stand."""

from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.truth import Row, Truth, measurements_of, put, states_of
from tidemap.history.erasing import forget
from tidemap.history.history import UNOBSERVED
from tidemap.history.measurements import Measurements
from tidemap.history.segment import SEGMENT_SAMPLES, Segment, merge, standing
from tidemap.history.timebase import TimeBase
from tidemap.storage.blobs import pack_segment, unpack_segment

CELLS = 4
NUMBER = -2
START = NUMBER * SEGMENT_SAMPLES
BASE = TimeBase(1_000.25, 60.0)
ROWS = st.builds(
    lambda sample, offset, cell, state: (float(BASE.time(START + sample)) + offset, cell, state),
    st.sampled_from([0, 1, 2, 3, 4090, SEGMENT_SAMPLES - 1]),
    st.sampled_from([0.0, 0.125, 30.0, 59.5]),
    st.integers(0, CELLS - 1),
    st.integers(0, 1),
)
BATCHES = st.lists(st.lists(ROWS, max_size=12), max_size=6)
quick = settings(max_examples=60)


def merged(batches: list[list[Row]], segment: Segment | None = None) -> Segment:
    segment = segment or Segment.empty(CELLS, NUMBER)
    for batch in batches:
        segment = merge(segment, measurements_of(batch), BASE)
    return segment


def truth_in(segment: Segment) -> Truth:
    """What a segment says, each measurement with the exact time it stands on."""
    states = segment.history.check().states()
    samples = BASE.sample(segment.time) - segment.history.start
    found: Truth = {}
    for cell, n in np.argwhere(states != UNOBSERVED).tolist():
        rank = 0 if segment.rank is None else int(segment.rank[cell, n])
        time = segment.time[samples == n][rank]
        found[cell, n + segment.history.start] = (float(time), int(states[cell, n]))
    return found


def truth_of(batches: list[list[Row]]) -> Truth:
    truth: Truth = {}
    for batch in batches:
        put(truth, batch, BASE)
    return truth


def assert_same(one: Segment, other: Segment) -> None:
    """Equal to the last bit, times and ranks included, and so are the stored bytes."""
    np.testing.assert_array_equal(one.history.observed, other.history.observed)
    np.testing.assert_array_equal(one.history.occupied, other.history.occupied)
    np.testing.assert_array_equal(one.time, other.time)
    assert (one.rank is None) == (other.rank is None)
    if one.rank is not None:
        np.testing.assert_array_equal(one.rank, other.rank)
    assert (one.surplus is None) == (other.surplus is None)
    if one.surplus is not None:
        np.testing.assert_array_equal(one.surplus, other.surplus)
    assert pack_segment(one) == pack_segment(other)


@quick
@given(BATCHES)
def test_a_segment_is_the_dictionary(batches: list[list[Row]]) -> None:
    segment, truth = merged(batches), truth_of(batches)
    assert truth_in(segment) == truth
    dense = states_of(truth, range(CELLS), START, START + SEGMENT_SAMPLES)
    np.testing.assert_array_equal(segment.history.states(), dense)


@quick
@given(BATCHES, st.randoms(use_true_random=False), st.integers(1, 5))
def test_order_batches_and_repeats_do_not_matter(batches: list[list[Row]], chance: Random, size: int) -> None:
    rows = [row for batch in batches for row in batch]
    shuffled = rows + rows[::2]
    chance.shuffle(shuffled)
    others = [shuffled[i : i + size] for i in range(0, len(shuffled), size)]
    assert_same(merged(batches), merged(others))
    assert_same(merged(batches), merged([rows]))


@quick
@given(BATCHES)
def test_no_time_is_kept_that_nothing_stands_on(batches: list[list[Row]]) -> None:
    segment = merged(batches)
    assert segment.time.tolist() == sorted({time for time, _ in truth_in(segment).values()})
    if segment.rank is not None:
        assert max(np.unique(BASE.sample(segment.time), return_counts=True)[1]) > 1
        assert not segment.rank[segment.history.states() == UNOBSERVED].any()


@quick
@given(BATCHES, BATCHES)
def test_a_segment_that_was_stored_goes_on_as_before(early: list[list[Row]], late: list[list[Row]]) -> None:
    stored = unpack_segment(pack_segment(merged(early)), NUMBER, "test")
    assert_same(merged(early), stored)
    assert_same(merged(early + late), merged(late, stored))


@quick
@given(BATCHES, BATCHES, st.integers(-1, SEGMENT_SAMPLES + 1))
def test_forgetting_leaves_the_later_samples_as_they_were(
    early: list[list[Row]], late: list[list[Row]], border: int
) -> None:
    before = START + border
    truth = {key: value for key, value in truth_of(early).items() if key[1] >= before}
    segment = forget(merged(early), before, BASE)
    assert truth_in(segment) == truth
    rows = [(time, cell, state) for (cell, _), (time, state) in truth.items()]
    assert_same(segment, merged([rows]))
    assert_same(merged(late, segment), merged([rows, *late]))


def test_more_times_in_one_sample_than_a_rank_can_count() -> None:
    """A door watched once a second on a map of one sample a day."""
    base = TimeBase(0.0, 86_400.0)
    seconds = np.arange(86_400, dtype=np.float64)
    rows = Measurements(seconds, np.zeros(86_400, np.uint32), (seconds % 3 == 2).astype(np.uint8))
    segment = merge(Segment.empty(1, 0), rows, base)
    assert segment.time.tolist() == [86_399.0]
    assert segment.rank is None
    assert segment.history.series(0, 0, 2).tolist() == [1, 2]


@pytest.mark.parametrize("sample", [START - 1, START + SEGMENT_SAMPLES])
def test_a_measurement_of_another_segment_is_refused(sample: int) -> None:
    with pytest.raises(ValueError, match="outside of the segment"):
        merged([[(float(BASE.time(sample)), 0, 1)]])


@quick
@given(BATCHES, BATCHES)
def test_a_segment_is_its_standing_measurements(one: list[list[Row]], other: list[list[Row]]) -> None:
    first, second = merged(one), merged(other)
    assert_same(merge(Segment.empty(CELLS, NUMBER), standing(first, BASE), BASE), first)
    assert_same(merge(first, standing(second, BASE), BASE), merged(one + other))

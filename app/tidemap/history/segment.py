"""Segment: the history of one chunk of cells over a fixed stretch of samples, with the exact times it stands on.

Of several measurements of a cell in one sample one stands, as the location's `combine` says (`combining`). To keep that
true for measurements that arrive late, a segment remembers the time of every measurement that stands: a sorted table of
distinct times, and, only where a sample holds more than one, the rank of each cell's time among its sample's.
"""

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from tidemap.history.combining import KEYS, LATEST, MAJORITY, put_ranked, put_single, put_votes, votes_of
from tidemap.history.ends import Ends, joined
from tidemap.history.history import UNOBSERVED, History
from tidemap.history.jit import kernel
from tidemap.history.measurements import Measurements
from tidemap.history.timebase import TimeBase

SEGMENT_SAMPLES = 4096
Number = TypeVar("Number", np.uint16, np.int32)


@dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """`history` (n_cells, n_samples); `time` (n_times,) float64 ascending; `rank` (n_cells, n_samples) uint16 or None.

    `surplus` (n_cells, n_samples) int32 or None: by how many a cell's measurements in a sample are more for occupied
    than for free, beyond the one that its state stands for; only `majority` has it.
    `ends`: when a cell's sensor said that it is unavailable; None where none did.
    Canonical: the same measurements are the same segment, to the last bit.
    """

    history: History
    time: NDArray[np.float64]
    rank: NDArray[np.uint16] | None
    surplus: NDArray[np.int32] | None = None
    ends: Ends | None = None

    @property
    def is_empty(self) -> bool:
        """Whether nothing was measured."""
        return not len(self.time) and self.ends is None

    @classmethod
    def empty(cls, n_cells: int, number: int) -> "Segment":
        """Segment `number` covers the samples from number x SEGMENT_SAMPLES on."""
        return cls(History.empty(n_cells, number * SEGMENT_SAMPLES, SEGMENT_SAMPLES), np.empty(0), None)


def since_gap(numbers: list[int], most: float) -> int:
    """The first of the segments since the last gap of more than `most` samples with no more of them before than since.

    >>> since_gap([0, 900, 901], 5000.0), since_gap([0, 1, 900], 5000.0), since_gap([], 5000.0)
    (900, 0, 0)
    """
    for i in reversed(range(1, len(numbers))):
        gap = (numbers[i] - numbers[i - 1] - 1) * SEGMENT_SAMPLES
        if gap > most and i <= len(numbers) - i:
            return numbers[i]
    return numbers[0] if numbers else 0


def lay(whole: History, segment: Segment) -> None:
    """In place: the planes of a segment where they belong in a longer history, which starts where a segment does."""
    first = (segment.history.start - whole.start) // 8
    part = slice(first, first + SEGMENT_SAMPLES // 8)
    whole.observed[:, part] = segment.history.observed
    whole.occupied[:, part] = segment.history.occupied


def merge(segment: Segment, measurements: Measurements, base: TimeBase, combine: str = LATEST) -> Segment:
    """The segment with the measurements in it; neither their order nor earlier merges matter, to the last bit.

    `measurements.cell` counts from the chunk's first cell and all samples lie in the segment (ValueError).
    O(measurements + bytes of the segment), and where a sample holds several times, or for `majority`, + n_cells x the
    samples from the first to the last that is measured: robots mostly see the latest.
    """
    says = measurements.says()
    if says.all():
        return replace(_merge(segment, measurements, None, base, combine), ends=segment.ends)
    other = measurements.select(~says)
    sample = other.samples(base) - segment.history.start
    if sample.min() < 0 or sample.max() >= segment.history.n_samples:
        raise ValueError("a measurement lies outside of the segment")
    ends = joined(segment.ends, Ends.of(other.cell, other.time, base), base)
    return replace(_merge(segment, measurements.select(says), None, base, combine), ends=ends)


def ends_of(segment: Segment, base: TimeBase) -> tuple[NDArray[np.uint32], NDArray[np.int64]]:
    """The cells and samples, (k,) each, with whose end nothing is held any more: where no later reading stands."""
    ends = segment.ends
    if ends is None:
        return np.zeros(0, np.uint32), np.zeros(0, np.int64)
    sample = base.sample(ends.time)
    read = segment.history.observed_at(ends.cell.astype(np.int64), sample)
    entry = np.searchsorted(base.sample(segment.time), sample[read])
    if segment.rank is not None:
        entry = entry + segment.rank[ends.cell[read], sample[read] - segment.history.start]
    last = np.ones(len(ends), np.bool_)
    last[read] = ends.time[read] > segment.time[entry]
    return ends.cell[last], sample[last]


def join(segment: Segment, other: Segment, base: TimeBase, combine: str = LATEST) -> Segment:
    """The segment with all that is in another one of the same samples, as if all of it had been merged."""
    measurements = standing(other, base)
    votes = None
    if other.surplus is not None:
        votes = votes_of(measurements.state) + other.surplus[other.history.states() != UNOBSERVED]
    return replace(_merge(segment, measurements, votes, base, combine), ends=joined(segment.ends, other.ends, base))


def _merge(
    segment: Segment, measurements: Measurements, votes: NDArray[np.int32] | None, base: TimeBase, combine: str
) -> Segment:
    if not len(measurements):
        return segment
    start, n_samples = segment.history.start, segment.history.n_samples
    sample = measurements.samples(base) - start
    if sample.min() < 0 or sample.max() >= n_samples:
        raise ValueError("a measurement lies outside of the segment")
    # Whole bytes of the planes.
    low, high = int(sample.min()) // 8 * 8, min(n_samples, int(sample.max()) // 8 * 8 + 8)
    times = np.searchsorted(base.sample(segment.time) - start, [low, high])
    part = _merge_part(_cut(segment, low, high, times), measurements, votes, sample - low, base, combine)
    return _paste(segment, part, low, high, times, base)


def _cut(segment: Segment, low: int, high: int, times: NDArray[np.int64]) -> Segment:
    """What a segment holds of its samples [low, high), whole bytes of them, whose times are those of the slice."""
    planes = [plane[:, low // 8 : -(-high // 8)].copy() for plane in _planes(segment)]
    rank = None if segment.rank is None else segment.rank[:, low:high].copy()
    surplus = None if segment.surplus is None else segment.surplus[:, low:high].copy()
    history = History(segment.history.start + low, high - low, *planes)
    return Segment(history, segment.time[slice(*times)], rank, surplus)


def _paste(segment: Segment, part: Segment, low: int, high: int, times: NDArray[np.int64], base: TimeBase) -> Segment:
    """The segment with `part` in the place of what `_cut` took of it."""
    observed, occupied = (plane.copy() for plane in _planes(segment))
    for plane, new in zip((observed, occupied), _planes(part), strict=True):
        plane[:, low // 8 : -(-high // 8)] = new
    history = History(segment.history.start, segment.history.n_samples, observed, occupied)
    time = np.concatenate([segment.time[: times[0]], part.time, segment.time[times[1] :]])
    several = bool((np.diff(base.sample(time)) == 0).any())
    rank = _pasted(segment.rank, part.rank, history, low, high) if several else None
    surplus = _pasted(segment.surplus, part.surplus, history, low, high)
    return Segment(history, time, rank, surplus if surplus is not None and surplus.any() else None)


def _pasted(
    whole: NDArray[Number] | None, part: NDArray[Number] | None, history: History, low: int, high: int
) -> NDArray[Number] | None:
    """A (n_cells, n_samples) array with `part` as its samples [low, high); None is zeros."""
    if part is None:
        if whole is not None:
            whole = whole.copy()
            whole[:, low:high] = 0
        return whole
    pasted = np.zeros((history.n_cells, history.n_samples), part.dtype) if whole is None else whole.copy()
    pasted[:, low:high] = part
    return pasted


def _planes(segment: Segment) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    return segment.history.observed, segment.history.occupied


def _merge_part(
    segment: Segment,
    measurements: Measurements,
    votes: NDArray[np.int32] | None,
    sample: NDArray[np.int64],
    base: TimeBase,
    combine: str,
) -> Segment:
    """As `_merge`, at the cost of the whole segment; `sample` counts from its first. Its arrays are written to."""
    start, n_samples = segment.history.start, segment.history.n_samples
    heads = measurements.heads
    table = np.union1d(segment.time, measurements.time[heads])
    first = np.searchsorted(base.sample(table) - start, np.arange(n_samples + 1))
    observed, occupied = _planes(segment)
    cell = measurements.cell.astype(np.int64)
    if combine != MAJORITY and np.diff(first).max(initial=0) <= 1:
        put_single(observed, occupied, cell, sample, measurements.state)
        return Segment(segment.history, table, None)
    entry = np.searchsorted(table, measurements.time[heads]) - first[sample[heads]]
    entry = np.repeat(entry, np.diff(heads, append=len(sample))).astype(np.int32)
    rank, surplus = _ranks(segment, table, first, base), None
    if combine == MAJORITY:
        surplus = np.zeros(rank.shape, np.int32) if segment.surplus is None else segment.surplus
        votes = votes_of(measurements.state) if votes is None else votes
        put_votes(observed, occupied, surplus, rank, cell, sample, entry, votes)
    else:
        put_ranked(observed, occupied, rank, cell, sample, entry, measurements.state, *KEYS[combine])
    return replace(_canonical(segment.history, table, rank, first), surplus=surplus)


def standing(segment: Segment, base: TimeBase) -> Measurements:
    """The measurements that a segment holds, cells counted from its first: merged into nothing they give it again."""
    history = segment.history
    cell, sample = np.nonzero(history.states() != UNOBSERVED)
    entry = np.searchsorted(base.sample(segment.time) - history.start, sample)
    if segment.rank is not None:
        entry = entry + segment.rank[cell, sample]
    return Measurements(segment.time[entry], cell.astype(np.uint32), history.states()[cell, sample])


def times_at(segment: Segment, sample: int, base: TimeBase) -> NDArray[np.float64]:
    """When each cell was read in one sample of the segment, (n_cells,) Unix seconds, NaN where it was not."""
    bit = sample - segment.history.start
    seen = (segment.history.observed[:, bit >> 3] >> np.uint8(bit & 7)) & np.uint8(1) != 0
    first = int(np.searchsorted(base.sample(segment.time), sample))
    rank = np.zeros(seen.size, np.int64) if segment.rank is None else segment.rank[:, bit].astype(np.int64)
    times = np.full(seen.size, np.nan)
    times[seen] = segment.time[first + rank[seen]]
    return times


def _ranks(segment: Segment, table: NDArray[np.float64], first: NDArray[np.int64], base: TimeBase) -> NDArray[np.int32]:
    """(n_cells, n_samples): the segment's ranks in a larger table of times, -1 where nothing was observed."""
    n_samples = segment.history.n_samples
    old = base.sample(segment.time) - segment.history.start
    renumbered = np.searchsorted(table, segment.time) - first[old]
    rank = np.full((segment.history.n_cells, n_samples), -1, np.int32)
    before = np.zeros((1, 1), np.uint16) if segment.rank is None else segment.rank
    at = np.searchsorted(old, np.arange(n_samples))
    _renumber(segment.history.observed, before, segment.rank is not None, at, renumbered, rank)
    return rank


def _canonical(
    history: History, table: NDArray[np.float64], rank: NDArray[np.int32], first: NDArray[np.int64]
) -> Segment:
    """A segment without the times that no measurement stands on, and without ranks where they say nothing."""
    used = np.zeros(len(table), np.bool_)
    _mark(rank, first, used)
    kept = np.concatenate([[0], np.cumsum(used)])
    new_first = kept[first]
    if np.diff(new_first).max(initial=0) <= 1:
        return Segment(history, table[used], None)
    narrow = np.zeros(rank.shape, np.uint16)
    _narrow(rank, first, kept, narrow)
    return Segment(history, table[used], narrow)


@kernel
def _renumber(
    observed: NDArray[np.uint8],
    before: NDArray[np.uint16],
    ranked: bool,
    at: NDArray[np.int64],
    renumbered: NDArray[np.int64],
    rank: NDArray[np.int32],
) -> None:
    """In place: the new rank of every measurement; `at` is where the old times of each sample begin."""
    for row in range(rank.shape[0]):
        for n in range(rank.shape[1]):
            if observed[row, n >> 3] >> np.uint8(n & 7) & np.uint8(1):
                rank[row, n] = renumbered[at[n] + (before[row, n] if ranked else 0)]


@kernel
def _mark(rank: NDArray[np.int32], first: NDArray[np.int64], used: NDArray[np.bool_]) -> None:
    """In place: which times some measurement stands on."""
    for row in range(rank.shape[0]):
        for n in range(rank.shape[1]):
            if rank[row, n] >= 0:
                used[first[n] + rank[row, n]] = True


@kernel
def _narrow(
    rank: NDArray[np.int32], first: NDArray[np.int64], kept: NDArray[np.int64], out: NDArray[np.uint16]
) -> None:
    """out: the ranks among the kept times, 0 where nothing was observed; `kept` counts those before each time."""
    for row in range(rank.shape[0]):
        for n in range(rank.shape[1]):
            if rank[row, n] >= 0:
                out[row, n] = kept[first[n] + rank[row, n]] - kept[first[n]]

"""Segment: the history of one chunk of cells over a fixed stretch of samples, with the exact times it stands on.

Of several measurements of a cell in one sample the one with the latest time stands (of two at the same time, the
occupied one). To keep that true for measurements that arrive late, a segment remembers the time of every
measurement that stands: a sorted table of distinct times, and, only where a sample holds more than one, the rank of
each cell's time among its sample's.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tidemap.history.history import UNOBSERVED, History
from tidemap.history.jit import kernel
from tidemap.history.measurements import Measurements
from tidemap.history.timebase import TimeBase

SEGMENT_SAMPLES = 4096


@dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """`history` (n_cells, n_samples); `time` (n_times,) float64 ascending; `rank` (n_cells, n_samples) uint16 or None.

    Canonical: the same standing measurements are the same segment, to the last bit.
    """

    history: History
    time: NDArray[np.float64]
    rank: NDArray[np.uint16] | None

    @classmethod
    def empty(cls, n_cells: int, number: int) -> "Segment":
        """Segment `number` covers the samples from number x SEGMENT_SAMPLES on."""
        return cls(History.empty(n_cells, number * SEGMENT_SAMPLES, SEGMENT_SAMPLES), np.empty(0), None)


def merge(segment: Segment, measurements: Measurements, base: TimeBase) -> Segment:
    """The segment with the measurements in it; neither their order nor earlier merges matter, to the last bit.

    `measurements.cell` counts from the chunk's first cell and all samples lie in the segment (ValueError).
    O(measurements + bytes of the segment), and where a sample holds several times + n_cells x the samples from the
    first to the last that is measured: robots mostly see the latest.
    """
    if not len(measurements):
        return segment
    start, n_samples = segment.history.start, segment.history.n_samples
    sample = measurements.samples(base) - start
    if sample.min() < 0 or sample.max() >= n_samples:
        raise ValueError("a measurement lies outside of the segment")
    # Whole bytes of the planes.
    low, high = int(sample.min()) // 8 * 8, min(n_samples, int(sample.max()) // 8 * 8 + 8)
    times = np.searchsorted(base.sample(segment.time) - start, [low, high])
    part = _merge(_cut(segment, low, high, times), measurements, sample - low, base)
    return _paste(segment, part, low, high, times, base)


def _cut(segment: Segment, low: int, high: int, times: NDArray[np.int64]) -> Segment:
    """What a segment holds of its samples [low, high), whole bytes of them, whose times are those of the slice."""
    planes = [plane[:, low // 8 : -(-high // 8)].copy() for plane in _planes(segment)]
    rank = None if segment.rank is None else segment.rank[:, low:high].copy()
    return Segment(History(segment.history.start + low, high - low, *planes), segment.time[slice(*times)], rank)


def _paste(segment: Segment, part: Segment, low: int, high: int, times: NDArray[np.int64], base: TimeBase) -> Segment:
    """The segment with `part` in the place of what `_cut` took of it."""
    observed, occupied = (plane.copy() for plane in _planes(segment))
    for plane, new in zip((observed, occupied), _planes(part), strict=True):
        plane[:, low // 8 : -(-high // 8)] = new
    history = History(segment.history.start, segment.history.n_samples, observed, occupied)
    time = np.concatenate([segment.time[: times[0]], part.time, segment.time[times[1] :]])
    if not (np.diff(base.sample(time)) == 0).any():
        return Segment(history, time, None)
    rank = np.zeros((history.n_cells, history.n_samples), np.uint16) if segment.rank is None else segment.rank.copy()
    rank[:, low:high] = 0 if part.rank is None else part.rank
    return Segment(history, time, rank)


def _planes(segment: Segment) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    return segment.history.observed, segment.history.occupied


def _merge(segment: Segment, measurements: Measurements, sample: NDArray[np.int64], base: TimeBase) -> Segment:
    """As `merge`, at the cost of the whole segment; `sample` counts from its first. Its planes are written to."""
    start, n_samples = segment.history.start, segment.history.n_samples
    heads = measurements.heads
    table = np.union1d(segment.time, measurements.time[heads])
    first = np.searchsorted(base.sample(table) - start, np.arange(n_samples + 1))
    observed, occupied = _planes(segment)
    cell = measurements.cell.astype(np.int64)
    if np.diff(first).max(initial=0) <= 1:
        _put(observed, occupied, cell, sample, measurements.state)
        return Segment(segment.history, table, None)
    entry = np.searchsorted(table, measurements.time[heads]) - first[sample[heads]]
    entry = np.repeat(entry, np.diff(heads, append=len(sample))).astype(np.int32)
    rank = _ranks(segment, table, first, base)
    _put_ranked(observed, occupied, rank, cell, sample, entry, measurements.state)
    return _canonical(segment.history, table, rank, first)


def forget(segment: Segment, before: int, base: TimeBase) -> Segment:
    """The segment without what was measured before sample `before`."""
    history, rank = segment.history, segment.rank
    border = min(max(before, history.start), history.stop)
    kept = history.window(border, history.stop).window(history.start, history.stop)
    if rank is not None:
        rank = rank.copy()
        rank[:, : border - history.start] = 0
    time = segment.time[base.sample(segment.time) >= before]
    return Segment(kept, time, rank if rank is not None and rank.any() else None)


def standing(segment: Segment, base: TimeBase) -> Measurements:
    """The measurements that a segment holds, cells counted from its first: merged into nothing they give it again."""
    history = segment.history
    cell, sample = np.nonzero(history.states() != UNOBSERVED)
    entry = np.searchsorted(base.sample(segment.time) - history.start, sample)
    if segment.rank is not None:
        entry = entry + segment.rank[cell, sample]
    return Measurements(segment.time[entry], cell.astype(np.uint32), history.states()[cell, sample])


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
def _put(
    observed: NDArray[np.uint8],
    occupied: NDArray[np.uint8],
    cell: NDArray[np.int64],
    sample: NDArray[np.int64],
    state: NDArray[np.uint8],
) -> None:
    """Write measurements; no two of them have the same sample and different times."""
    for i in range(cell.size):
        row, byte = cell[i], sample[i] >> 3
        mask = np.uint8(1) << np.uint8(sample[i] & 7)
        observed[row, byte] |= mask
        if state[i]:
            occupied[row, byte] |= mask


@kernel
def _put_ranked(
    observed: NDArray[np.uint8],
    occupied: NDArray[np.uint8],
    rank: NDArray[np.int32],
    cell: NDArray[np.int64],
    sample: NDArray[np.int64],
    entry: NDArray[np.int32],
    state: NDArray[np.uint8],
) -> None:
    """Write the measurements that stand; `entry` is the rank of each."""
    for i in range(cell.size):
        row, n = cell[i], sample[i]
        if entry[i] < rank[row, n] or (entry[i] == rank[row, n] and not state[i]):
            continue
        rank[row, n] = entry[i]
        mask = np.uint8(1) << np.uint8(n & 7)
        observed[row, n >> 3] |= mask
        if state[i]:
            occupied[row, n >> 3] |= mask
        else:
            occupied[row, n >> 3] &= ~mask


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

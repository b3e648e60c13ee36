"""Segment: the history of one chunk of cells over a fixed stretch of samples, with the exact times it stands on.

Of several measurements of a cell in one sample the one with the latest time stands (of two at the same time, the
occupied one). To keep that true for measurements that arrive late, a segment remembers the time of every
measurement that stands: a sorted table of distinct times, and, only where a sample holds more than one, the rank of
each cell's time among its sample's.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.spectral.history import UNOBSERVED, History
from app.spectral.jit import kernel
from app.spectral.measurements import Measurements
from app.spectral.timebase import TimeBase

SEGMENT_SAMPLES = 4096


@dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """`history` (n_cells, n_samples); `time` (n_times,) ascending float64; `rank` (n_cells, n_samples) uint16 or None."""

    history: History
    time: NDArray[np.float64]
    rank: NDArray[np.uint16] | None

    @classmethod
    def empty(cls, n_cells: int, number: int) -> "Segment":
        """Segment `number` covers the samples from number x SEGMENT_SAMPLES on."""
        return cls(History.empty(n_cells, number * SEGMENT_SAMPLES, SEGMENT_SAMPLES), np.empty(0), None)


def merge(segment: Segment, measurements: Measurements, base: TimeBase) -> Segment:
    """The segment with the measurements in it; neither their order nor earlier merges matter.

    `measurements.cell` counts from the chunk's first cell and all samples lie in the segment (ValueError).
    O(measurements + n_cells x n_samples / 4).
    """
    start, n_samples = segment.history.start, segment.history.n_samples
    sample = base.sample(measurements.time) - start
    if len(sample) and (sample.min() < 0 or sample.max() >= n_samples):
        raise ValueError("a measurement lies outside of the segment")
    heads = np.flatnonzero(np.diff(measurements.time, prepend=np.nan) != 0)
    table = np.union1d(segment.time, measurements.time[heads])
    first = np.searchsorted(base.sample(table) - start, np.arange(n_samples + 1))
    entry = np.searchsorted(table, measurements.time[heads]) - first[sample[heads]]
    rank = _ranks(segment, table, first, base)
    history = segment.history
    observed, occupied = history.observed.copy(), history.occupied.copy()
    replaced = _put(
        observed,
        occupied,
        np.zeros((1, 1), np.uint16) if rank is None else rank,
        rank is not None,
        measurements.cell.astype(np.int64),
        sample,
        np.repeat(entry, np.diff(heads, append=len(sample))).astype(np.uint16),
        measurements.state,
    )
    merged = Segment(History(start, n_samples, observed, occupied), table, rank)
    return _prune(merged, first) if replaced and rank is not None else merged


def forget(segment: Segment, before: int, base: TimeBase) -> Segment:
    """The segment without what was measured before sample `before`."""
    history = segment.history
    kept = history.window(max(before, history.start), history.stop).window(history.start, history.stop)
    return Segment(kept, segment.time[base.sample(segment.time) >= before], segment.rank)


def _ranks(
    segment: Segment, table: NDArray[np.float64], first: NDArray[np.int64], base: TimeBase
) -> NDArray[np.uint16] | None:
    """The segment's ranks in a larger table of times, None when no sample has two."""
    largest = int(np.diff(first).max(initial=0))
    if largest <= 1:
        return None
    if largest > np.iinfo(np.uint16).max:
        raise ValueError(
            "more than 65,535 observation times stand in one sample; choose a shorter interval_s"
        )
    n_cells, n_samples = segment.history.n_cells, segment.history.n_samples
    old = base.sample(segment.time) - segment.history.start
    new_rank = (np.searchsorted(table, segment.time) - first[old]).astype(np.uint16)
    old_first = np.searchsorted(old, np.arange(n_samples))
    if segment.rank is None:
        column = np.zeros(n_samples, np.uint16)
        column[old] = new_rank
        return np.repeat(column[None, :], n_cells, axis=0)
    padded = np.append(new_rank, np.uint16(0))
    position = np.minimum(old_first[None, :] + segment.rank, len(new_rank))
    return np.ascontiguousarray(padded[position])


def _prune(segment: Segment, first: NDArray[np.int64]) -> Segment:
    """Without the times that no measurement stands on any more."""
    if segment.rank is None:
        return segment
    seen = segment.history.states() != UNOBSERVED
    position = first[:-1][None, :] + segment.rank
    used = np.bincount(position[seen], minlength=len(segment.time)) > 0
    if used.all():
        return segment
    kept = np.concatenate([[0], np.cumsum(used)])
    new_first = kept[first]
    if np.diff(new_first).max(initial=0) <= 1:
        return Segment(segment.history, segment.time[used], None)
    rank = np.where(seen, kept[np.minimum(position, len(used))] - new_first[:-1][None, :], 0)
    return Segment(segment.history, segment.time[used], rank.astype(np.uint16))


@kernel
def _put(
    observed: NDArray[np.uint8],
    occupied: NDArray[np.uint8],
    rank: NDArray[np.uint16],
    ranked: bool,
    cell: NDArray[np.int64],
    sample: NDArray[np.int64],
    entry: NDArray[np.uint16],
    state: NDArray[np.uint8],
) -> int:
    """Write the measurements that stand; returns how many earlier ones they replaced."""
    replaced = 0
    for i in range(cell.size):
        c, n = cell[i], sample[i]
        byte, bit = n >> 3, np.uint8(1 << (n & 7))
        if observed[c, byte] & bit:
            before = rank[c, n] if ranked else entry[i]
            stands = entry[i] > before or (entry[i] == before and state[i] == 1)
            if not stands:
                continue
            if entry[i] != before:
                replaced += 1
        observed[c, byte] |= bit
        if ranked:
            rank[c, n] = entry[i]
        if state[i]:
            occupied[c, byte] |= bit
        else:
            occupied[c, byte] &= ~bit
    return replaced

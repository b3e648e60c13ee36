"""Erasing: a segment without what was measured at some times."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tidemap.history.history import UNOBSERVED, History
from tidemap.history.jit import kernel
from tidemap.history.segment import Segment
from tidemap.history.timebase import TimeBase


def erase(segment: Segment, gone: NDArray[np.bool_], base: TimeBase) -> tuple[Segment, int]:
    """The segment without the measurements on those of its times that are `gone` (n_times,), and how many those were.

    Others of their samples, in whose place they stand, go with them.
    O(times), and where some of them stay and some go + n_cells x n_samples.
    """
    if not gone.any():
        return segment, 0
    history = segment.history
    before = int(history.count_observed().sum())
    if gone.all():
        empty = History.empty(history.n_cells, history.start, history.n_samples)
        return Segment(empty, np.empty(0), None, ends=segment.ends), before
    left = _without(segment, gone, base)
    return left, before - int(left.history.count_observed().sum())


def erase_all(
    segment: Segment, choose: Callable[[NDArray[np.float64]], NDArray[np.bool_]], base: TimeBase
) -> tuple[Segment, int]:
    """As `erase`, of the times that `choose` takes, with what sensors said then of not being available."""
    left, erased = erase(segment, choose(segment.time), base)
    if segment.ends is None:
        return left, erased
    gone = choose(segment.ends.time)
    ends = None if gone.all() else segment.ends.select(~gone)
    return replace(left, ends=ends), erased + int(np.count_nonzero(gone))


def forget(segment: Segment, before: int, base: TimeBase) -> Segment:
    """The segment without what was measured before sample `before`."""
    return erase_all(segment, lambda time: np.asarray(time < base.time(before)), base)[0]


def _without(segment: Segment, gone: NDArray[np.bool_], base: TimeBase) -> Segment:
    """The segment without the measurements on the times that are `gone` (n_times,)."""
    history = segment.history
    at = np.searchsorted(base.sample(segment.time) - history.start, np.arange(history.n_samples + 1))
    kept = np.concatenate([[0], np.cumsum(~gone)])
    observed, occupied = history.observed.copy(), history.occupied.copy()
    rank = np.zeros((1, 1), np.uint16) if segment.rank is None else segment.rank.copy()
    _erase(observed, occupied, rank, segment.rank is not None, at, gone, kept)
    left = History(history.start, history.n_samples, observed, occupied)
    several = np.diff(kept[at]).max(initial=0) > 1
    return Segment(left, segment.time[~gone], rank if several else None, _observed_surplus(segment, left), segment.ends)


def _observed_surplus(segment: Segment, left: History) -> NDArray[np.int32] | None:
    """The surplus of what is left of a segment."""
    if segment.surplus is None:
        return None
    surplus = np.where(left.states() == UNOBSERVED, np.int32(0), segment.surplus)
    return surplus if surplus.any() else None


@kernel
def _erase(
    observed: NDArray[np.uint8],
    occupied: NDArray[np.uint8],
    rank: NDArray[np.uint16],
    ranked: bool,
    at: NDArray[np.int64],
    gone: NDArray[np.bool_],
    kept: NDArray[np.int64],
) -> None:
    """In place: the measurements on times that stay, their ranks counted among those; `at` is where those of each
    sample begin, `kept` how many before each stay."""
    for row in range(observed.shape[0]):
        for n in range(at.size - 1):
            mask = np.uint8(1) << np.uint8(n & 7)
            if not observed[row, n >> 3] & mask:
                continue
            entry = at[n] + (rank[row, n] if ranked else 0)
            if gone[entry]:
                observed[row, n >> 3] &= ~mask
                occupied[row, n >> 3] &= ~mask
            if ranked:
                rank[row, n] = 0 if gone[entry] else kept[entry] - kept[at[n]]

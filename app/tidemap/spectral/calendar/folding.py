"""Folding: a history counted into quarters of an hour of civil days, all that `calendar` needs of it.

The counts of a week's slots are sufficient for a model that is constant within a slot, whatever the
weights of whole days; how far that is from the unfolded fit is a test.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from tidemap.history.bits import LAST, ONE, Plane, Words, aligned_word, ones
from tidemap.history.history import History
from tidemap.history.jit import fused_kernel, kernel
from tidemap.history.timebase import TimeBase
from tidemap.spectral.calendar.waves import DAY_S, PHASES, SLOT_S, SLOTS, SLOTS_A_DAY, WEEK_S
from tidemap.spectral.civil import civil_seconds

DAYS_A_WEEK = 7
MAX_DAYS = 182
"""Only the latest half year is folded: what bounds the cost of any history."""
PIECE = 1 << 20
ZERO, SIX = np.uint64(0), np.uint64(6)


@dataclass(frozen=True, slots=True, eq=False)
class Visits:
    """Runs of samples in one slot of one civil day, each from the end of the one before: (n,) int64 each.

    stop: sample bits of the window; day: civil days since `first_day`; slot: 0 … 95.
    first_day counts days from Monday, 5 January 1970; the window touches n_days of them.
    """

    stop: NDArray[np.int64]
    day: NDArray[np.int64]
    slot: NDArray[np.int64]
    first_day: int
    n_days: int
    phase: NDArray[np.int64] | None = None

    def phased(self, period_s: float | None) -> "Visits":
        """With the phase (n,), 0 … PHASES - 1, of a period of civil time in the middle of each visit's slot."""
        if period_s is None:
            return self
        middle = ((self.first_day + self.day) * SLOTS_A_DAY + self.slot + 0.5) * SLOT_S
        return replace(self, phase=(middle / period_s % 1 * PHASES).astype(np.int64))


@dataclass(frozen=True, slots=True, eq=False)
class Weeks:
    """Weighted visits per slot of the civil week, and those occupied: (n_weights, n_cells, 672) float32 each.

    Of visits with phases each slot is split by phase, (n_weights, n_cells, 672 · PHASES).

    A visit counts 1 on average: several samples of a slot on one day repeat each other. Of one that
    was occupied for a part that part is in `n_occupied`.
    """

    n_observed: NDArray[np.float32]
    n_occupied: NDArray[np.float32]


def recent(history: History, base: TimeBase) -> History:
    """The latest MAX_DAYS of a history."""
    most = int(MAX_DAYS * DAY_S / base.interval_s)
    return history if history.n_samples <= most else history.window(history.stop - most, history.stop)


def visits(start: int, stop: int, base: TimeBase, time_zone: str) -> Visits:
    """The visits of the samples [start, stop); the clock is read PIECE samples at a time."""
    begin, slot = [], []
    before = -1
    for first in range(start, stop, PIECE):
        samples = np.arange(first, min(first + PIECE, stop))
        number = np.floor(civil_seconds(base.time(samples), time_zone) / SLOT_S).astype(np.int64)
        new = np.flatnonzero(np.diff(number, prepend=before))
        begin.append(new + (first - start))
        slot.append(number[new])
        before = int(number[-1])
    begins, slots = np.concatenate(begin), np.concatenate(slot)
    day = slots // SLOTS_A_DAY
    first_day, last_day = int(day.min()), int(day.max())
    ends = np.append(begins[1:], stop - start)
    return Visits(ends, day - first_day, slots % SLOTS_A_DAY, first_day, last_day - first_day + 1)


def fold(history: History, rows: NDArray[np.int64], visits: Visits, weight: NDArray[np.float32]) -> Weeks:
    """Some cells of a history, every day counted with its weights (n_weights, n_days).

    0.1 ms per cell and year of quarters of an hour, whatever the samples an hour.
    """
    split = 1 if visits.phase is None else PHASES
    slot = visits.slot if visits.phase is None else visits.slot * PHASES + visits.phase
    shape = (weight.shape[0], rows.size, SLOTS * split)
    weeks = Weeks(np.zeros(shape, np.float32), np.zeros(shape, np.float32))
    count = np.zeros((rows.size, 2), np.int64)
    end = np.append(np.flatnonzero(np.diff(visits.day)) + 1, visits.day.size)
    offset = ((visits.first_day + visits.day[end - 1]) % DAYS_A_WEEK) * SLOTS_A_DAY * split
    by_day = np.ascontiguousarray(weight.T[visits.day[end - 1]])
    planes = (history.observed, history.occupied)
    stop = visits.stop.astype(np.uint64)
    _count(*planes, rows, stop, slot, end, offset, by_day, weeks.n_observed, weeks.n_occupied, count)
    scale = (count[:, 0] / np.maximum(count[:, 1], 1)).astype(np.float32)
    return Weeks(weeks.n_observed * scale[:, np.newaxis], weeks.n_occupied * scale[:, np.newaxis])


def days_seen(history: History, rows: NDArray[np.int64], visits: Visits) -> NDArray[np.int64]:
    """On how many civil days each cell was observed, (n_rows,)."""
    end = np.append(np.flatnonzero(np.diff(visits.day)) + 1, visits.day.size)
    days = np.zeros(rows.size, np.int64)
    _count_days(history.observed, rows, visits.stop[end - 1].astype(np.uint64), days)
    return days


def recency(now: int, half_life_days: float, n_days: int | None = None) -> NDArray[np.float32]:
    """The weight of every day, (n_days,), by default `now`: the last before `now` counts 1, one half_life_days
    before it a half; later ones, which do not know better, also 1."""
    age = np.maximum(now - 1 - np.arange(now if n_days is None else n_days), 0)
    return np.asarray(2.0 ** (-age / half_life_days), np.float32)


@lru_cache(maxsize=256)
def slot_offset_s(base: TimeBase) -> float:
    """How far into their slots the samples of a time base begin on average, in seconds.

    The same in all time zones, as clocks are apart by whole slots.
    """
    n_samples = int(min(100_000, max(1, WEEK_S // base.interval_s)))
    return float(np.mean(base.time(np.arange(n_samples)) % SLOT_S))


@kernel
def _rank(plane: Plane, cell: int, stop: Words, word: Words, before: Words, rank: NDArray[np.int32]) -> None:
    """rank[v + 1]: the set bits of a row before bit stop[v]; word, before hold a row's words and their ranks."""
    total = ZERO
    for at in range(word.size):
        word[at] = aligned_word(plane, cell, at)
        before[at] = total
        total += np.uint64(ones(word[at]))
    rank[0] = 0
    for visit in range(stop.size):
        at = stop[visit] >> SIX
        below = (ONE << (stop[visit] & LAST)) - ONE
        rank[visit + 1] = np.int32(before[at] + np.uint64(ones(word[at] & below)))


@kernel
def _count_days(observed: Plane, row: NDArray[np.int64], stop: Words, days: NDArray[np.int64]) -> None:
    word = np.empty(observed.shape[1] // 8 + 2, np.uint64)
    before, rank = np.empty(word.size, np.uint64), np.empty(stop.size + 1, np.int32)
    for i in range(row.size):
        _rank(observed, row[i], stop, word, before, rank)
        for day in range(stop.size):
            days[i] += rank[day + 1] > rank[day]


@fused_kernel
def _count(
    observed: Plane,
    occupied: Plane,
    row: NDArray[np.int64],
    stop: Words,
    slot: NDArray[np.int64],
    end: NDArray[np.int64],
    offset: NDArray[np.int64],
    weight: NDArray[np.float32],
    n_observed: NDArray[np.float32],
    n_occupied: NDArray[np.float32],
    count: NDArray[np.int64],
) -> None:
    """n_observed, n_occupied (n_weights, n, 672) += weight (n_days, n_weights) · samples of the visits of a day.

    Visits reach from one `stop` to the next; those of a day reach to `end` (n_days,), and its slots
    begin at `offset`. count (n, 2): visits and samples observed.
    """
    word = np.empty(observed.shape[1] // 8 + 2, np.uint64)
    before = np.empty(word.size, np.uint64)
    observed_rank, occupied_rank = np.empty(stop.size + 1, np.int32), np.empty(stop.size + 1, np.int32)
    for i in range(row.size):
        _rank(observed, row[i], stop, word, before, observed_rank)
        _rank(occupied, row[i], stop, word, before, occupied_rank)
        for visit in range(stop.size):
            count[i, 0] += observed_rank[visit + 1] > observed_rank[visit]
        count[i, 1] = observed_rank[stop.size]
        first = 0
        for day in range(end.size):
            last = end[day]
            to = offset[day] + slot[first]
            apart = slot[last - 1] - slot[first] != last - 1 - first
            for which in range(weight.shape[1]):
                share = weight[day, which]
                if share == np.float32(0):
                    continue
                if apart:
                    for visit in range(first, last):
                        to = offset[day] + slot[visit]
                        n_observed[which, i, to] += share * np.float32(observed_rank[visit + 1] - observed_rank[visit])
                        n_occupied[which, i, to] += share * np.float32(occupied_rank[visit + 1] - occupied_rank[visit])
                else:
                    for x in range(last - first):
                        at = first + x
                        n_observed[which, i, to + x] += share * np.float32(observed_rank[at + 1] - observed_rank[at])
                        n_occupied[which, i, to + x] += share * np.float32(occupied_rank[at + 1] - occupied_rank[at])
            first = last

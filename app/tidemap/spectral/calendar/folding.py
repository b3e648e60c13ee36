"""Folding: a history counted into quarters of an hour of civil days, all that `calendar` needs of it.

The counts of a week's slots are sufficient for a model that is constant within a slot, whatever the
weights of whole days; how far that is from the unfolded fit is a test.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from tidemap.history.bits import LAST, ONE, Plane, Words, aligned_word, ones
from tidemap.history.history import History
from tidemap.history.jit import fused_kernel, kernel
from tidemap.history.timebase import TimeBase
from tidemap.spectral.calendar.waves import PHASES, SLOT_S, SLOTS, SLOTS_A_DAY
from tidemap.spectral.civil import DAY_S, DAYS_A_WEEK, WEEK_S, civil_seconds, weekdays

MAX_DAYS = 182
"""Only the latest half year in which something was seen is folded: what bounds the cost of any history."""
PIECE = 1 << 20
ZERO, SIX = np.uint64(0), np.uint64(6)


@dataclass(frozen=True, slots=True, eq=False)
class Visits:
    """Runs of samples in one slot of one civil day, those in which some cell was seen: (n,) int64 each.

    start, stop: sample bits of the window; day: 0 … n_days - 1, of the days on which something was seen; slot: 0 … 95.
    date (n_days,), today: civil days from Monday, 5 January 1970; today is that of the last sample, seen or not.
    weekday (n_days,): 0 Monday … 6 Sunday, which public holidays count as.
    """

    start: NDArray[np.int64]
    stop: NDArray[np.int64]
    day: NDArray[np.int64]
    slot: NDArray[np.int64]
    date: NDArray[np.int64]
    weekday: NDArray[np.int64]
    today: int
    phase: NDArray[np.int64] | None = None

    @property
    def n_days(self) -> int:
        """On how many days something was seen."""
        return int(self.date.size)

    @property
    def last_of_day(self) -> NDArray[np.int64]:
        """The last visit of every day, (n_days,)."""
        return np.searchsorted(self.day, np.arange(self.n_days), side="right") - 1

    def phased(self, period_s: float | None) -> "Visits":
        """With the phase (n,), 0 … PHASES - 1, of a period of civil time in the middle of each visit's slot."""
        if period_s is None:
            return self
        day = (self.date - self.date % DAYS_A_WEEK + self.weekday)[self.day]
        middle = (day * SLOTS_A_DAY + self.slot + 0.5) * SLOT_S
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
    """The latest MAX_DAYS of a history in which something was seen, and what is between them."""
    a_day = DAY_S / base.interval_s
    if history.n_samples <= MAX_DAYS * a_day:
        return history
    age = np.unique((history.stop - 1 - history.seen()) // a_day)
    if age.size <= MAX_DAYS:
        return history
    return history.window(history.stop - int((age[MAX_DAYS - 1] + 1) * a_day), history.stop)


def visits(history: History, base: TimeBase, time_zone: str, calendar: str | None = None) -> Visits:
    """The visits of a history; the clock is read PIECE samples at a time.

    Public holidays of `calendar` (an ISO 3166 code) count as Sundays.
    """
    seen = history.seen()
    pieces = [_slots(seen[first : first + PIECE], base, time_zone) for first in range(0, seen.size, PIECE)]
    number = np.concatenate([np.zeros(0, np.int64), *pieces])
    begin = np.flatnonzero(np.diff(number, prepend=-1))
    last = np.append(begin[1:], number.size)[: begin.size] - 1
    date, day = np.unique(number[begin] // SLOTS_A_DAY, return_inverse=True)
    bit, slot = seen - history.start, number[begin] % SLOTS_A_DAY
    today = int(_slots(np.array([history.stop - 1]), base, time_zone)[0]) // SLOTS_A_DAY
    return Visits(bit[begin], bit[last] + 1, day.ravel(), slot, date, weekdays(date, calendar), today)


def _slots(sample: NDArray[np.int64], base: TimeBase, time_zone: str) -> NDArray[np.int64]:
    """The quarters of an hour of the clock, since Monday, 5 January 1970, that the middles of samples lie in."""
    return (civil_seconds(base.middle(sample), time_zone) // SLOT_S).astype(np.int64)


def fold(
    history: History,
    rows: NDArray[np.int64],
    visits: Visits,
    weight: NDArray[np.float32],
    half_life_days: Sequence[float] | None = None,
) -> Weeks:
    """Some cells of a history, every day counted with its weights (n_weights, n_days).

    With half-lives (n_weights,) each also by its age: the days after it on which the cell was seen and whose weight is
    not 0. 0.1 ms per cell and year of quarters of an hour, whatever the samples an hour.
    """
    split = 1 if visits.phase is None else PHASES
    slot = visits.slot if visits.phase is None else visits.slot * PHASES + visits.phase
    shape = (weight.shape[0], rows.size, SLOTS * split)
    weeks = Weeks(np.zeros(shape, np.float32), np.zeros(shape, np.float32))
    count = np.zeros((rows.size, 2), np.int64)
    end = visits.last_of_day + 1
    offset = visits.weekday * SLOTS_A_DAY * split
    by_day = np.ascontiguousarray(weight.T)
    lives = [math.inf] * weight.shape[0] if half_life_days is None else half_life_days
    by_age = np.stack([recency(visits.n_days, life)[::-1] for life in lives], axis=1)
    planes = (history.observed, history.occupied)
    stop = visits.stop.astype(np.uint64)
    _count(*planes, rows, stop, slot, end, offset, by_day, by_age, weeks.n_observed, weeks.n_occupied, count)
    scale = (count[:, 0] / np.maximum(count[:, 1], 1)).astype(np.float32)
    return Weeks(weeks.n_observed * scale[:, np.newaxis], weeks.n_occupied * scale[:, np.newaxis])


def days_seen(history: History, rows: NDArray[np.int64], visits: Visits) -> NDArray[np.int64]:
    """On how many civil days each cell was observed, (n_rows,)."""
    days = np.zeros(rows.size, np.int64)
    _count_days(history.observed, rows, visits.stop[visits.last_of_day].astype(np.uint64), days)
    return days


def visits_seen(history: History, rows: NDArray[np.int64], visits: Visits) -> NDArray[np.int64]:
    """In how many of the visits each cell was observed, (n_rows,); the cost is one step an observation."""
    seen = np.zeros(rows.size, np.int64)
    visit = np.repeat(np.arange(visits.stop.size, dtype=np.int32), np.diff(visits.stop, prepend=0))
    _count_visits(history.observed, rows, visit, seen)
    return seen


def recency(n_days: int, half_life_days: float) -> NDArray[np.float32]:
    """The weight of each of so many days, (n_days,): the last counts 1, one half_life_days before it a half."""
    return np.asarray(2.0 ** (-np.arange(n_days)[::-1] / half_life_days), np.float32)


@lru_cache(maxsize=256)
def slot_offset_s(base: TimeBase) -> float:
    """How far into their slots the middles of the samples of a time base are on average, in seconds.

    The same in all time zones, as clocks are apart by whole slots.
    """
    n_samples = int(min(100_000, max(1, WEEK_S // base.interval_s)))
    return float(np.mean(base.middle(np.arange(n_samples)) % SLOT_S))


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


@kernel
def _count_visits(observed: Plane, row: NDArray[np.int64], visit: NDArray[np.int32], seen: NDArray[np.int64]) -> None:
    """visit (n_samples,): that of each sample, up to the last that is in one."""
    for i in range(row.size):
        last = -1
        for at in range(-(-observed.shape[1] // 8)):
            word = aligned_word(observed, row[i], at)
            while word != ZERO:
                lowest = word & (~word + ONE)
                current = visit[64 * at + ones(lowest - ONE)]
                seen[i] += current != last
                last, word = current, word ^ lowest


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
    by_age: NDArray[np.float32],
    n_observed: NDArray[np.float32],
    n_occupied: NDArray[np.float32],
    count: NDArray[np.int64],
) -> None:
    """n_observed, n_occupied (n_weights, n, 672) += weight (n_days, n_weights) · samples of the visits of a day.

    by_age (n_days, n_weights) multiplies the weight of a day by its age: see `fold`. Visits reach from one `stop` to
    the next; those of a day reach to `end` (n_days,), and its slots begin at `offset`. count (n, 2): visits and samples
    observed.
    """
    aged = np.empty(weight.shape, np.float32)
    word = np.empty(observed.shape[1] // 8 + 2, np.uint64)
    before = np.empty(word.size, np.uint64)
    observed_rank, occupied_rank = np.empty(stop.size + 1, np.int32), np.empty(stop.size + 1, np.int32)
    for i in range(row.size):
        _rank(observed, row[i], stop, word, before, observed_rank)
        _rank(occupied, row[i], stop, word, before, occupied_rank)
        for visit in range(stop.size):
            count[i, 0] += observed_rank[visit + 1] > observed_rank[visit]
        count[i, 1] = observed_rank[stop.size]
        for which in range(weight.shape[1]):
            age = 0
            for day in range(end.size - 1, -1, -1):
                first = end[day - 1] if day else 0
                seen = weight[day, which] != np.float32(0) and observed_rank[end[day]] > observed_rank[first]
                aged[day, which] = weight[day, which] * by_age[age, which] if seen else np.float32(0)
                age += seen
        first = 0
        for day in range(end.size):
            last = end[day]
            to = offset[day] + slot[first]
            apart = slot[last - 1] - slot[first] != last - 1 - first
            for which in range(weight.shape[1]):
                share = aged[day, which]
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

"""Trials: parts of a history to be predicted from the rest, and how well probabilities did on them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tidemap.history.history import History
from tidemap.history.timebase import TimeBase
from tidemap.spectral.calendar import folding
from tidemap.spectral.calendar.folding import Visits, Weeks
from tidemap.spectral.calendar.waves import SLOTS, SLOTS_A_DAY
from tidemap.spectral.evaluation import LOG_LOSS_FLOOR, Scores

SHORT_DAYS = 14
"""Shorter histories are tried by leaving out every single day; of longer ones the later half is predicted."""
MAX_TRIALS = 8
MAX_TRIAL_DAYS = 7


@dataclass(frozen=True, slots=True)
class Trial:
    """Days [first, last) of a history, of those on which something was seen, are predicted.

    From the days before, or from all others where `around`.
    """

    first: int
    last: int
    around: bool

    def learned(self, n_days: int) -> NDArray[np.bool_]:
        """(n_days,) the days learned from."""
        day = np.arange(n_days)
        return (day < self.first) | (self.around & (day >= self.last))


def plan(n_days: int, most: int = MAX_TRIALS) -> list[Trial]:
    """The trials of a history in which something was seen on `n_days` civil days; days of nothing are not counted.

    >>> [(trial.first, trial.last) for trial in plan(28, 4)]
    [(16, 19), (19, 22), (22, 25), (25, 28)]
    """
    if n_days < SHORT_DAYS:
        days = np.unique(np.linspace(0, n_days - 1, min(most, n_days)).astype(int)) if n_days > most else range(n_days)
        return [Trial(int(day), int(day) + 1, True) for day in days]
    span = min(MAX_TRIAL_DAYS, n_days // 8)
    count = min(most, n_days // (2 * span))
    return [Trial(n_days - span * (i + 1), n_days - span * i, False) for i in reversed(range(count))]


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """Some cells, the trials on them, and what was then seen: (n_trials, n_cells, 672) visits by slot.

    `check` is called between the steps of what takes long; what it raises ends that.
    """

    history: History
    base: TimeBase
    visits: Visits
    time_zone: str
    trials: Sequence[Trial]
    truth: Weeks
    period_s: float | None = None
    calendar: str | None = None
    check: Callable[[], None] = lambda: None

    @property
    def cells(self) -> NDArray[np.int64]:
        return np.arange(self.history.n_cells)

    def phased(self, period_s: float) -> "Task":
        """The same with every slot split by the phase of a period: truth (n_trials, n_cells, 672 · PHASES)."""
        split = self.visits.phased(period_s)
        return replace(self, visits=split, period_s=period_s, truth=_truth(self.history, split, self.trials))

    def past(self, trial: Trial) -> History:
        """What a trial learns from; the days it predicts are unobserved."""
        before = self._first_sample(trial.first)
        past = self.history.window(self.history.start, before)
        if not trial.around:
            return past
        return past.overlay(self.history.window(self._first_sample(trial.last), self.history.stop))

    def times(self, trial: Trial) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """The slots of the week a trial predicts and the middles of the visits to them, (n,) each."""
        chosen = np.flatnonzero((self.visits.day >= trial.first) & (self.visits.day < trial.last))
        middle = (self.visits.start[chosen] + self.visits.stop[chosen] - 1) / 2 + self.history.start
        weekday = self.visits.weekday[self.visits.day[chosen]]
        return weekday * SLOTS_A_DAY + self.visits.slot[chosen], self.base.time(middle)

    def _first_sample(self, day: int) -> int:
        visit = int(np.searchsorted(self.visits.day, day))
        return self.history.start + int(self.visits.start[visit]) if visit < self.visits.day.size else self.history.stop


def task(history: History, base: TimeBase, time_zone: str, most: int, calendar: str | None = None) -> Task:
    """The trials of all cells of a history."""
    visits = folding.visits(history, base, time_zone, calendar)
    trials = plan(visits.n_days, most)
    return Task(history, base, visits, time_zone, trials, _truth(history, visits, trials), calendar=calendar)


def _truth(history: History, visits: Visits, trials: Sequence[Trial]) -> Weeks:
    tested = np.zeros((len(trials), visits.n_days), np.float32)
    for trial, row in zip(trials, tested, strict=True):
        row[trial.first : trial.last] = 1
    return folding.fold(history, np.arange(history.n_cells), visits, tested)


def losses(probability: NDArray[Any], truth: Weeks) -> NDArray[np.float64]:
    """The log loss of every row, summed over its slots: (…,) for probability, n_observed, n_occupied (…, 672)."""
    p = np.clip(probability, LOG_LOSS_FLOOR, 1 - LOG_LOSS_FLOOR)
    free = truth.n_observed - truth.n_occupied
    return np.asarray(-(truth.n_occupied * np.log(p) + free * np.log1p(-p)).sum(axis=-1), np.float64)


def scores(probability: NDArray[np.float32], truth: Weeks) -> Scores:
    """As `evaluation.score`, a visit to a slot counting as one measurement; NaN probabilities are left out."""
    known = ~np.isnan(probability)
    p = np.where(known, probability, np.float32(0.5)).astype(np.float64)
    n_observed, n_occupied = truth.n_observed * known, truth.n_occupied * known
    n = float(n_observed.sum())
    if not n:
        return Scores(float("nan"), float("nan"), float("nan"), 0)
    wrong = np.where(p > 0.5, n_observed - n_occupied, n_occupied).sum()
    brier = (n_observed * p * p - 2 * n_occupied * p + n_occupied).sum()
    return Scores(
        float(wrong / n), float(brier / n), float(losses(p, Weeks(n_observed, n_occupied)).sum() / n), round(n)
    )


def empty(task: Task) -> NDArray[np.float32]:
    """Probabilities to be filled, (n_trials, n_cells, 672) NaN."""
    return np.full((len(task.trials), task.history.n_cells, SLOTS), np.nan, np.float32)

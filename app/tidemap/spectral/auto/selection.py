"""Selection: `auto`, the choice of estimator, order and priors by what predicted a history's own days best."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tidemap.history.history import History
from tidemap.history.timebase import TimeBase
from tidemap.spectral.auto import trials
from tidemap.spectral.auto.blending import FEW_CELLS, MARGINS, Blend, blend, grid, trust
from tidemap.spectral.auto.trials import MAX_TRIALS, Task
from tidemap.spectral.calendar import folding
from tidemap.spectral.civil import DAY_S
from tidemap.spectral.estimators import fit
from tidemap.spectral.evaluation import Scores
from tidemap.spectral.prediction import predict_times
from tidemap.spectral.recipe import PRIORS, Prior, Recipe
from tidemap.spectral.spectrum import truncate
from tidemap.spectral.window import fft_window

MIN_DAYS = 2
MIN_READINGS = 24
"""Samples in which something was seen, however far apart, from which on anything but the mean is tried."""
MAX_SAMPLES = 1 << 22
"""Samples, cells times length, that are transformed in a trial."""
MAX_FITS = 1 << 13
"""Fits of `calendar` over all trials, priors and cells: with MAX_SAMPLES what bounds the cost."""
CALENDAR_ORDERS = (16, 32, 64)
SIMPLER = -4.0
"""Belief in `static` and `fft`, as a logarithm: `calendar` averages settings of hardly a rhythm, too, and what beats
it in a few trials seldom does so afterwards."""


@dataclass(frozen=True, slots=True)
class Row:
    """How one candidate did, over all trials: see `trials.scores`; n counts visits to quarters of an hour."""

    estimator: str
    order: int
    error: float
    brier: float
    log_loss: float
    n: int


@dataclass(frozen=True, slots=True)
class Choice:
    """The choice, the table it was made from (empty where there was too little to try), the cells tried."""

    estimator: str
    order: int
    table: tuple[Row, ...]
    reason: str
    cells: int
    time_zone: str = "UTC"
    priors: tuple[Prior, ...] = PRIORS
    period_s: float | None = None
    carry_over: float = 0.0
    level_sd: float = 0.0
    calendar: str | None = None

    @property
    def recipe(self) -> Recipe:
        """What to fit all cells by."""
        return Recipe(
            self.estimator,
            self.order,
            self.time_zone,
            self.priors,
            self.period_s,
            self.carry_over,
            self.level_sd,
            self.calendar,
        )


def choose(
    history: History,
    base: TimeBase,
    orders: Sequence[int] = (1, 2, 3, 5, 10, 15),
    max_cells: int = 64,
    time_zone: str | None = None,
    estimator: str = "auto",
    check: Callable[[], None] = lambda: None,
    calendar: str | None = None,
) -> Choice:
    """The candidate with the least log loss on days it was not fitted to.

    Histories under two weeks are tried by leaving out days, longer ones by predicting the later half
    in parts of up to a week, each from all before it. Cells that change, spread evenly over all of
    them, pooled. The same history always gives the same choice; of equal candidates the simpler one.
    The estimator `calendar` is tried where a time zone is given; public holidays of the country `calendar` (an ISO 3166
    code) count as Sundays. Of a single order that is the order of all; of
    several they are those of `fft`. Another `estimator` than auto leaves only the rest open. It takes
    seconds; `check` is called meanwhile, and what it raises ends it.
    """
    found = _choose(history, base, orders, max_cells, time_zone, estimator, check, calendar)
    return replace(found, calendar=calendar)


def _choose(
    history: History,
    base: TimeBase,
    orders: Sequence[int],
    max_cells: int,
    time_zone: str | None,
    estimator: str,
    check: Callable[[], None],
    calendar: str | None,
) -> Choice:
    if few := _too_few(history, base):
        return _without(estimator, orders, time_zone, few)
    recent = folding.recent(history, base)
    recent = recent.window(max(recent.start, recent.stop - MAX_SAMPLES), recent.stop)
    changing = _changing(recent, max_cells, time_zone, base)
    if not changing.size:
        return _without(estimator, orders, time_zone, "no cell has changed")
    most = MAX_TRIALS if changing.size <= FEW_CELLS else MAX_TRIALS // 2
    task = replace(trials.task(recent.cells(changing), base, time_zone or "UTC", most, calendar), check=check)
    if task.visits.n_days < MIN_DAYS:
        return _without(estimator, orders, time_zone, f"cells that changed were seen on less than {MIN_DAYS} days")
    mixed = blend(task) if time_zone is not None and estimator in ("auto", "calendar") else None
    table = tuple(_table(task, sorted(set(orders)), mixed, estimator))
    return _decide(table, task, mixed, time_zone, estimator, orders)


def _too_few(history: History, base: TimeBase) -> str:
    """Why a history is too short to try anything on, empty where it is not."""
    if math.floor(history.n_samples * base.interval_s / DAY_S + 1e-9) < MIN_DAYS:
        return f"less than {MIN_DAYS} days of history: the mean is all it tells"
    readings = history.seen().size
    if readings < MIN_READINGS:
        return f"only {readings} reading{'s' * (readings != 1)} in the history: the mean is all they tell"
    return ""


def _without(
    estimator: str,
    orders: Sequence[int],
    time_zone: str | None,
    reason: str,
    table: tuple[Row, ...] = (),
    cells: int = 0,
) -> Choice:
    """The mean, or what was asked for at the order asked for or its least, as nothing could be tried."""
    if estimator in ("auto", "static"):
        return Choice("static", 0, table, reason, cells, time_zone or "UTC")
    order = orders[0] if len(orders) == 1 else {"fft": 0}.get(estimator, CALENDAR_ORDERS[0])
    return Choice(estimator, order, table, reason, cells, time_zone or "UTC")


def _changing(history: History, most: int, time_zone: str | None, base: TimeBase) -> NDArray[np.int64]:
    """Cells that changed, evenly spread, as many as the cost allows; of many never so few that they pass for few."""
    changing = history.changing()
    most = min(most, MAX_SAMPLES // history.n_samples)
    if time_zone is not None:
        days = math.ceil(history.n_samples * base.interval_s / DAY_S)
        fits = len(grid(base.interval_s, changing.size, days)[0]) * MAX_TRIALS
        most = min(most, 2 * MAX_FITS // fits)
    most = max(most, min(FEW_CELLS + 1, changing.size))
    return changing if changing.size <= most else changing[np.arange(most) * changing.size // most]


def _table(task: Task, orders: Sequence[int], mixed: Blend | None, estimator: str) -> Iterator[Row]:
    """The scores of every candidate, simple ones first."""
    if estimator in ("auto", "static"):
        yield _row("static", 0, trials.scores(_tried(task, "static", [0])[0], task.truth))
    if estimator in ("auto", "fft"):
        for order, probability in zip(orders, _tried(task, "fft", orders), strict=True):
            yield _row("fft", order, trials.scores(probability, task.truth))
    if mixed is not None:
        for order in orders if len(orders) == 1 else CALENDAR_ORDERS:
            yield _row("calendar", order, trials.scores(mixed.probability(order), mixed.truth))


def _row(estimator: str, order: int, found: Scores) -> Row:
    return Row(estimator, order, found.error, found.brier, found.log_loss, found.n)


def _tried(task: Task, estimator: str, orders: Sequence[int]) -> list[NDArray[np.float32]]:
    """What each order predicted, (n_trials, n_cells, 672): fitted once, smaller ones are first components."""
    every = [trials.empty(task) for _ in orders]
    for i, trial in enumerate(task.trials):
        task.check()
        past = task.past(trial)
        window = fft_window(past.seen(), past.start, past.stop, task.base.interval_s)
        if window[0] == window[1]:
            continue
        fitted = fit(past.window(*window), estimator, max(orders), task.base)
        slot, time = task.times(trial)
        for order, probability in zip(orders, every, strict=True):
            probability[i][:, slot] = predict_times(truncate(fitted, order), time)
    return every


def _decide(
    table: tuple[Row, ...],
    task: Task,
    mixed: Blend | None,
    time_zone: str | None,
    estimator: str,
    orders: Sequence[int],
) -> Choice:
    scored = [row for row in table if row.n]
    n_cells = task.history.n_cells
    if not scored:
        none = "nothing was observed on the days to be predicted"
        return _without(estimator, orders, time_zone, none, table, n_cells)
    best = max(scored, key=lambda row: _belief(row) - trust(task) * row.log_loss * row.n)
    if best.estimator == "calendar":
        worst = MARGINS[n_cells > FEW_CELLS] * best.log_loss
        close = [row for row in scored if row.estimator == "calendar" and row.log_loss <= worst]
        best = min(close, key=lambda row: row.order)
    found = Choice(best.estimator, best.order, table, _reason(best, len(table), task), n_cells, time_zone or "UTC")
    if mixed is None or best.estimator != "calendar":
        return found
    reason = found.reason + _settings(mixed)
    return replace(
        found,
        reason=reason,
        priors=mixed.priors,
        period_s=mixed.period_s,
        carry_over=mixed.carry_over,
        level_sd=mixed.level_sd,
    )


def _belief(row: Row) -> float:
    """What is believed of a candidate beforehand, as a logarithm; of `fft` less with every order."""
    return 0.0 if row.estimator == "calendar" else SIMPLER - row.order / 8


def _reason(best: Row, n_candidates: int, task: Task) -> str:
    name = best.estimator if best.estimator == "static" else f"{best.estimator} of order {best.order}"
    days = task.trials[0].last - task.trials[0].first
    parts = f"{len(task.trials)} part{'s' * (len(task.trials) > 1)} of {days} day{'s' * (days != 1)}"
    learned = "all other days" if task.trials[0].around else "the days before"
    return f"{name} predicted {parts} from {learned} best of {n_candidates} candidates: log loss {best.log_loss:.3f}"


def _settings(mixed: Blend) -> str:
    first = mixed.priors[0]
    life = "all days alike" if math.isinf(first.half_life_days) else f"half-life {first.half_life_days:g} days"
    period = "" if mixed.period_s is None else f", with a period of {mixed.period_s / 3600:.3g} hours"
    return (
        f"; it averages {len(mixed.priors)} of {mixed.tried} settings, the first by {first.week}, "
        f"{first.detail}, evidence {first.evidence:g}, {life}{period}; {mixed.carry_over:.0%} of the last day's "
        "departure is kept"
    )

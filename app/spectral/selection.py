"""Selection: `auto`, the choice of estimator and order by forward chaining on a history."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.spectral.estimators import fit
from app.spectral.evaluation import score
from app.spectral.history import History
from app.spectral.prediction import predict_times
from app.spectral.spectrum import truncate
from app.spectral.timebase import TimeBase
from app.spectral.window import DAY_S, fit_window

MIN_DAYS = 2
FOLDS = 3
MAX_SAMPLES = 1 << 22
"""Samples, cells times length, that are fitted in a fold: what bounds the cost."""
MAX_TIMES = 4096
"""Times of a fold that are scored, spread evenly."""


@dataclass(frozen=True, slots=True)
class Row:
    """How one candidate did, over all folds: see `evaluation.Scores`."""

    estimator: str
    order: int
    error: float
    brier: float
    log_loss: float
    n: int


@dataclass(frozen=True, slots=True)
class Selection:
    """The choice, the table it was made from (empty where there was too little to try), the cells tried."""

    estimator: str
    order: int
    table: tuple[Row, ...]
    reason: str
    cells: int


@dataclass(frozen=True, slots=True)
class Fold:
    """Fitted to samples [start, split), scored on [split, stop)."""

    start: int
    split: int
    stop: int


def choose(
    history: History,
    base: TimeBase,
    orders: Sequence[int] = (1, 2, 3, 5, 10, 15),
    max_cells: int = 64,
) -> Selection:
    """The candidate with the least log loss on samples later than those it was fitted to.

    Up to three folds, the latest days of the history; cells that change, spread evenly over all of
    them, pooled. The same history always gives the same choice. Of equal candidates the simpler
    one. Cost is bounded: at most MAX_SAMPLES are fitted and max_cells · MAX_TIMES scored per fold.
    """
    days = math.floor(history.n_samples * base.interval_s / DAY_S + 1e-9)
    if days < MIN_DAYS:
        return Selection("static", 0, (), f"less than {MIN_DAYS} days of history: the mean is all it tells", 0)
    recent = history.window(max(history.start, history.stop - MAX_SAMPLES), history.stop)
    changing = _changing(recent, max(1, min(max_cells, MAX_SAMPLES // recent.n_samples)))
    if not changing.size:
        return Selection("static", 0, (), "no cell has changed", 0)
    folds = _folds(recent, base)
    if not folds:
        return Selection("static", 0, (), "too many samples a day to try anything", 0)
    table = _table(recent.cells(changing), base, folds, sorted(set(orders)))
    scored = [row for row in table if row.n]
    if not scored:
        return Selection("static", 0, table, "nothing was observed on the days to be predicted", changing.size)
    best = min(scored, key=lambda row: row.log_loss)
    return Selection(best.estimator, best.order, table, _reason(best, len(table), folds, base), changing.size)


def _changing(history: History, most: int) -> NDArray[np.int64]:
    occupied, observed = history.count_occupied(), history.count_observed()
    changing = np.flatnonzero((occupied > 0) & (occupied < observed))
    if changing.size <= most:
        return changing
    return changing[np.arange(most) * changing.size // most]


def _folds(history: History, base: TimeBase) -> list[Fold]:
    """Each part scored is a day long, of longer histories up to a week, and follows the one before."""
    day = round(DAY_S / base.interval_s) or 1
    days = history.n_samples // day
    n_folds = min(FOLDS, days - 1)
    span = day * max(1, min(7, days // (2 * FOLDS)))
    first = history.stop - n_folds * span
    return [
        Fold(history.start, first + i * span, first + (i + 1) * span)
        for i in range(n_folds)
        if first + i * span > history.start
    ]


def _table(history: History, base: TimeBase, folds: Sequence[Fold], orders: Sequence[int]) -> tuple[Row, ...]:
    candidates = [("static", 0), *(("fft", order) for order in orders)]
    predicted: dict[tuple[str, int], list[NDArray[np.float32]]] = {each: [] for each in candidates}
    observed = []
    for fold in folds:
        states, probabilities = _try(history, base, fold, candidates)
        observed.append(states.ravel())
        for candidate, probability in probabilities:
            predicted[candidate].append(probability.ravel())
    every = np.concatenate(observed)
    rows = []
    for (estimator, order), parts in predicted.items():
        scores = score(np.concatenate(parts), every)
        rows.append(Row(estimator, order, scores.error, scores.brier, scores.log_loss, scores.n))
    return tuple(rows)


def _try(
    history: History, base: TimeBase, fold: Fold, candidates: Sequence[tuple[str, int]]
) -> tuple[NDArray[np.uint8], Iterator[tuple[tuple[str, int], NDArray[np.float32]]]]:
    """What was observed in a fold and what each candidate had predicted, (n_cells, n_times) each.

    Every estimator is fitted once, at its greatest order; smaller ones are its first components.
    """
    past = history.window(*fit_window(fold.start, fold.split, base.interval_s))
    n_times = min(MAX_TIMES, fold.stop - fold.split)
    ahead = np.arange(n_times) * (fold.stop - fold.split) // n_times
    greatest = {name: max(order for each, order in candidates if each == name) for name, _ in candidates}
    fitted = {name: fit(past, name, order, base) for name, order in greatest.items()}
    time = base.time(fold.split + ahead)
    probabilities = (((name, order), predict_times(truncate(fitted[name], order), time)) for name, order in candidates)
    return history.window(fold.split, fold.stop).states()[:, ahead], probabilities


def _reason(best: Row, n_candidates: int, folds: Sequence[Fold], base: TimeBase) -> str:
    days = (folds[0].stop - folds[0].split) * base.interval_s / DAY_S
    name = best.estimator if best.estimator == "static" else f"{best.estimator} of order {best.order}"
    parts = f"{len(folds)} part{'s' * (len(folds) > 1)} of {days:g} day{'s' * (days != 1)}"
    return f"{name} predicted the latest {parts} best of {n_candidates} candidates: log loss {best.log_loss:.3f}"

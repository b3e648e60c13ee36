"""Evaluation: how good probabilities were, against what was then observed."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tidemap.history.history import UNOBSERVED
from tidemap.spectral.prediction import predict_times
from tidemap.spectral.spectrum import Spectrum

LOG_LOSS_FLOOR = 1e-3
"""Probabilities are clipped to [1e-3, 1 - 1e-3] for the log loss: one wrong certainty costs 6.9 nats."""

BINS = 10
"""Bins of a reliability table."""

BLOCK_VALUES = 1 << 19
"""Predictions that are made and scored at once."""


@dataclass(frozen=True, slots=True)
class Scores:
    """error: share of p > 0.5 ≠ s; brier: mean of (p - s)²; log_loss in nats; n: measurements scored."""

    error: float
    brier: float
    log_loss: float
    n: int


@dataclass(frozen=True, slots=True, eq=False)
class Reliability:
    """Per bin of predicted probability, (bins,): its mean, the observed rate (NaN if empty), the count."""

    probability_mean: NDArray[np.float64]
    observed_rate: NDArray[np.float64]
    count: NDArray[np.int64]


class ScoreSums:
    """Scores and reliability that are added up part by part, so that nothing has to be kept.

    confidence: what the error counts as occupied, p > confidence; None: p > 0.5.
    """

    def __init__(self, confidence: float | None = None, bins: int = BINS) -> None:
        self._confidence = 0.5 if confidence is None else confidence
        self._bins = bins
        self._sums = np.zeros(3)
        self._table = np.zeros((3, bins))
        self.n = 0

    def add(self, probability: ArrayLike, state: ArrayLike) -> None:
        """Add a part of any shape; pairs with an unobserved state or a NaN probability are left out.

        ValueError where the shapes differ.
        """
        p, s = scored(probability, state)
        q = np.clip(p, LOG_LOSS_FLOOR, 1 - LOG_LOSS_FLOOR)
        wrong = np.count_nonzero((p > self._confidence) != (s == 1))
        self._sums += (wrong, np.sum((p - s) ** 2), -np.sum(np.log(np.where(s == 1, q, 1 - q))))
        location = np.minimum((p * self._bins).astype(np.int64), self._bins - 1)
        for row, weights in enumerate((None, p, s)):
            self._table[row] += np.bincount(location, weights, self._bins)
        self.n += p.size

    def add_predicted(
        self,
        spectrum: Spectrum,
        time: NDArray[np.float64],
        states: NDArray[np.uint8],
        check: Callable[[], None] = lambda: None,
    ) -> None:
        """Add what a spectrum predicts for `time` (n_times,) and what was seen then, states (n_cells, n_times).

        Block by block of times; `check` is called before each, what it raises ends the scoring.
        """
        step = max(1, BLOCK_VALUES // len(states))
        for first in range(0, len(time), step):
            check()
            part = slice(first, first + step)
            self.add(predict_times(spectrum, time[part]), states[:, part])

    def scores(self) -> Scores:
        """The scores of all parts; all NaN where nothing was scored."""
        error, brier, log_loss = (self._sums / self.n if self.n else np.full(3, np.nan)).tolist()
        return Scores(error, brier, log_loss, self.n)

    def reliability(self) -> Reliability:
        """The reliability table over equal bins of [0, 1]; p = 1 belongs to the last."""
        count, p, s = self._table
        mean, rate = np.full((2, self._bins), np.nan)
        np.divide(p, count, out=mean, where=count > 0)
        np.divide(s, count, out=rate, where=count > 0)
        return Reliability(mean, rate, count.astype(np.int64))


def score(probability: ArrayLike, state: ArrayLike) -> Scores:
    """Scores of probabilities against states of the same shape; all NaN where nothing can be scored.

    Pairs with an unobserved state or a NaN probability are left out.

    >>> score([0.0, 1.0, 0.5], [0, 1, 2]).error
    0.0
    """
    tally = ScoreSums()
    tally.add(probability, state)
    return tally.scores()


def scored(probability: ArrayLike, state: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """The pairs that can be scored, flat; ValueError where the shapes differ."""
    p, s = np.asarray(probability, np.float64), np.asarray(state, np.uint8)
    if p.shape != s.shape:
        raise ValueError(f"probabilities of shape {p.shape} and states of shape {s.shape}")
    usable = (s != UNOBSERVED) & ~np.isnan(p)
    return p[usable], s[usable]


def reliability(probability: ArrayLike, state: ArrayLike, bins: int = BINS) -> Reliability:
    """The reliability table over `bins` equal bins of [0, 1]; p = 1 belongs to the last."""
    tally = ScoreSums(bins=bins)
    tally.add(probability, state)
    return tally.reliability()


def accuracy(outliers: int, observed: int) -> float | None:
    """The share of observed samples that are no outliers; None where nothing was observed."""
    return 1 - outliers / observed if observed else None


def expected_calibration_error(table: Reliability) -> float:
    """The mean of |predicted - observed| over the bins, weighted by count; NaN for an empty table."""
    filled = table.count > 0
    if not filled.any():
        return float("nan")
    gap = np.abs(table.probability_mean - table.observed_rate)[filled]
    return float(np.average(gap, weights=table.count[filled]))

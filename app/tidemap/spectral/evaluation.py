"""Evaluation: how good probabilities were, against what was then observed."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tidemap.history.history import UNOBSERVED

LOG_LOSS_FLOOR = 1e-3
"""Probabilities are clipped to [1e-3, 1 - 1e-3] for the log loss: one wrong certainty costs 6.9 nats."""


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


def score(probability: ArrayLike, state: ArrayLike) -> Scores:
    """Scores of probabilities against states of the same shape; all NaN where nothing can be scored.

    Pairs with an unobserved state or a NaN probability are left out.

    >>> score([0.0, 1.0, 0.5], [0, 1, 2]).error
    0.0
    """
    p, s = scored(probability, state)
    if p.size == 0:
        return Scores(float("nan"), float("nan"), float("nan"), 0)
    q = np.clip(p, LOG_LOSS_FLOOR, 1 - LOG_LOSS_FLOOR)
    return Scores(
        error=float(np.mean((p > 0.5) != (s == 1))),
        brier=float(np.mean((p - s) ** 2)),
        log_loss=float(-np.mean(np.log(np.where(s == 1, q, 1 - q)))),
        n=int(p.size),
    )


def scored(probability: ArrayLike, state: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """The pairs that can be scored, flat; ValueError where the shapes differ."""
    p, s = np.asarray(probability, np.float64), np.asarray(state, np.uint8)
    if p.shape != s.shape:
        raise ValueError(f"probabilities of shape {p.shape} and states of shape {s.shape}")
    usable = (s != UNOBSERVED) & ~np.isnan(p)
    return p[usable], s[usable]


def reliability(probability: ArrayLike, state: ArrayLike, bins: int = 10) -> Reliability:
    """The reliability table over `bins` equal bins of [0, 1]; p = 1 belongs to the last."""
    p, s = scored(probability, state)
    place = np.minimum((p * bins).astype(np.int64), bins - 1)
    count = np.bincount(place, minlength=bins)
    mean, rate = np.full(bins, np.nan), np.full(bins, np.nan)
    np.divide(np.bincount(place, p, bins), count, out=mean, where=count > 0)
    np.divide(np.bincount(place, s, bins), count, out=rate, where=count > 0)
    return Reliability(mean, rate, count.astype(np.int64))


def expected_calibration_error(table: Reliability) -> float:
    """The mean of |predicted - observed| over the bins, weighted by count; NaN for an empty table."""
    filled = table.count > 0
    if not filled.any():
        return float("nan")
    gap = np.abs(table.probability_mean - table.observed_rate)[filled]
    return float(np.average(gap, weights=table.count[filled]))

"""Anomalies: measurements the spectrum did not expect (IV-B)."""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Rule = Literal["surprise", "paper"]


def surprise(probability: ArrayLike, state: ArrayLike) -> NDArray[np.float64]:
    """|p - s|, 0 where fully expected, 1 where thought impossible; NaN where p is."""
    return np.abs(np.asarray(probability, np.float64) - np.asarray(state, np.float64))


def is_anomalous(
    probability: ArrayLike, state: ArrayLike, confidence: float, rule: Rule = "surprise"
) -> NDArray[np.bool_]:
    """Which measurements (state 0 or 1) are anomalous; never where p is NaN.

    "surprise": |p - s| > c. "paper": s ≠ (p > c), Eq. 6 as printed, which calls every occupied
    measurement with p ≤ c anomalous. ValueError on another rule.

    >>> is_anomalous([0.02, 0.6], [1, 1], 0.95), is_anomalous([0.02, 0.6], [1, 1], 0.95, "paper")
    (array([ True, False]), array([ True,  True]))
    """
    p, s = np.asarray(probability, np.float64), np.asarray(state)
    if rule == "surprise":
        return np.asarray(surprise(p, s) > confidence)
    if rule == "paper":
        return np.asarray(((p > confidence) != (s == 1)) & ~np.isnan(p))
    raise ValueError(f"unknown rule {rule!r}; known are surprise, paper")

"""Level: how far the last days were from the rhythm of the week, and how far weeks to come may be.

People are ill, away or in a hurry for days on end, so that yesterday's departure from the rhythm says more of
the days to come than the same day a week ago. And a level learned from few weeks is not yet that of the next.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tidemap.spectral.calendar.logistic import Vector, response
from tidemap.spectral.calendar.products import Matrix

HALF_LIFE_DAYS: Final = 1.0
"""How soon the days before the last count less."""
VISITS: Final = 3.0
"""The prior precision of a departure, in visits times p (1 - p): one such visit moves the level by little."""
MAX_DEPARTURE: Final = 1.0
"""The greatest departure followed, on the logit scale: one strange day must not turn everything over."""
STEPS = 8


def latest_days(date: NDArray[np.int64], today: int) -> Vector:
    """The weights of days (n_days,) by their date: 1 of today, 0 of later ones.

    By the calendar, whether something was seen meanwhile or not: moods do not outlast a pause.
    """
    age = today - date
    return np.asarray(np.where(age >= 0, 2.0 ** (-np.maximum(age, 0) / HALF_LIFE_DAYS), 0), np.float32)


def outlasting(days: int) -> float:
    """What is left of a departure over the days of a week, on average, to what is left of it over the first `days`.

    It halves every HALF_LIFE_DAYS: what was seen of the next day alone is more than what will be of the week.
    """
    left = 2.0 ** (-np.arange(7) / HALF_LIFE_DAYS)
    return float(left.mean() / left[:days].mean())


def departures(eta: Matrix, n_observed: Matrix, n_occupied: Matrix) -> Vector:
    """What, added to the logits of every row (n_rows, n_slots), makes the visits of its last days likeliest.

    n_observed, n_occupied: visits and those occupied, weighed by HALF_LIFE_DAYS.
    Newton steps, bounded by MAX_DEPARTURE.
    """
    apart = np.zeros((eta.shape[0], 1), np.float32)
    for _ in range(STEPS):
        residual, curvature = response(eta + apart, n_observed, n_occupied)
        slope = residual.sum(axis=1, keepdims=True) - np.float32(VISITS) * apart
        bend = curvature.sum(axis=1, keepdims=True) + np.float32(VISITS)
        apart = np.clip(apart + slope / bend, -MAX_DEPARTURE, MAX_DEPARTURE).astype(np.float32)
    return apart[:, 0]


def caution(level_sd: float, days: NDArray[np.int64]) -> Vector:
    """By what the logits of a rhythm learned from so many days are multiplied.

    The mean of a logistic function over a normal level of variance v is close to that of the logit times
    (1 + π v / 8)^-½; v falls as the weeks seen grow.
    """
    variance = level_sd**2 * 7 / np.maximum(days, 1)
    return np.asarray((1 + math.pi / 8 * variance) ** -0.5, np.float32)

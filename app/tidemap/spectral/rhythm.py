"""Rhythm: how often something is usually heard, and which silence is longer than usual.

A silence is measured in what was expected of it: the number of intervals in which something is usually heard at that
hour of that weekday. By that measure the nights of a robot that works by day are no silence, and what speaks at random
is like what speaks as a clock (time rescaling): a silence can be compared with earlier ones at any hour. Seconds would
compare nights with working hours; a model of each interval by itself would take gaps, which come in clusters, to be
impossible.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

HOUR_S = 3600.0
WEEK_HOURS = 168
MIN_WEEKS = 2
"""In so many weeks something has to be heard at an hour of a weekday, or nothing is expected then."""
WEEKS = 4
"""How many weeks before the last time that something was heard say what is usual."""
EXCEPTIONS = WEEKS
"""So many of the longest silences of these weeks are taken for exceptions: one a week."""
FACTOR = 3.0
"""How many times the longest of the others a silence has to be. What speaks by chance, in bursts, gives 0.025 events a
week and location with 3, and 0.15 with 2, which finds a silence a fifth to a half sooner."""
MIN_EXPECTED = 3.0
"""And so many intervals with something to hear, at least."""


@dataclass(frozen=True, slots=True, eq=False)
class Rhythm:
    """expected: (168,) the share of intervals with something to hear at each hour of the civil week.

    longest: the silence, in intervals with something to hear, that is not exceeded by what is usual.
    """

    expected: NDArray[np.float64]
    longest: float

    @classmethod
    def of(cls, heard: NDArray[np.bool_], civil_s: NDArray[np.float64]) -> "Rhythm":
        """From the intervals (n,) in which something was heard, the last one of them, and their civil times (n,)."""
        hour, week = hour_of_week(civil_s), np.floor(civil_s / (HOUR_S * WEEK_HOURS)).astype(np.int64)
        count = np.bincount(hour, minlength=WEEK_HOURS)
        share = np.bincount(hour, heard, WEEK_HOURS) / np.maximum(count, 1)
        weeks = np.unique(np.stack((hour[heard], week[heard])), axis=1)[0]
        expected = np.where(np.bincount(weeks, minlength=WEEK_HOURS) >= MIN_WEEKS, share, 0.0)
        passed = np.cumsum(expected[hour])[heard]
        # Without the interval in which something is heard again.
        gaps = np.sort(np.diff(passed) - expected[hour[heard][1:]])[::-1]
        usual = float(gaps[min(EXCEPTIONS, len(gaps) - 1)]) if len(gaps) else 0.0
        return cls(expected, max(MIN_EXPECTED, FACTOR * usual))

    def silence(self, civil_s: NDArray[np.float64]) -> float:
        """In how many of some intervals (m,) without anything something was to be heard."""
        return float(self.expected[hour_of_week(civil_s)].sum())


def hour_of_week(civil_s: NDArray[np.float64]) -> NDArray[np.int64]:
    """The hour of the week of civil times, whatever day it begins with."""
    return np.floor(civil_s / HOUR_S).astype(np.int64) % WEEK_HOURS

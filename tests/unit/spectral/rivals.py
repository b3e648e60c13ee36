"""What `auto` has to beat: histograms of civil time, shrunk towards coarser ones. For evaluation only."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Kind = Literal["day", "weekend", "weekday"]
KINDS: tuple[Kind, ...] = ("day", "weekend", "weekday")
SLOT_S = 900
"""What every bin is a multiple of."""
SLOTS = 86_400 // SLOT_S


@dataclass(frozen=True, slots=True, eq=False)
class Tally:
    """How often each slot of the civil week was seen, and seen occupied: (7, SLOTS); and the usual interval."""

    seen: NDArray[np.float64]
    full: NDArray[np.float64]
    interval_s: float

    @classmethod
    def of(cls, tau_s: NDArray[np.float64], state: NDArray[np.uint8]) -> "Tally":
        """Of the past: observed samples, (n,), at civil seconds."""
        slot = slots(tau_s)
        seen, full = (np.bincount(slot, each, 7 * SLOTS).reshape(7, SLOTS) for each in (None, state))
        return cls(seen.astype(np.float64), full.astype(np.float64), float(np.median(np.diff(tau_s))))

    def by(self, kind: Kind, bin_s: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The counts of bins: (1, n_bins) of all days, or (7, n_bins), each weekday with those of its kind."""
        n_bins = round(86_400 / bin_s)
        seen, full = (each.reshape(7, n_bins, -1).sum(axis=2) for each in (self.seen, self.full))
        return _together(seen, kind), _together(full, kind)


def slots(tau_s: NDArray[np.float64]) -> NDArray[np.int64]:
    """The slots of the civil week of civil seconds."""
    return np.asarray(tau_s % 604_800 // SLOT_S, np.int64)


def histogram(
    past: Tally, ahead: NDArray[np.int64], kind: Kind, bin_s: float = 1800.0, visits: float = 1.0
) -> NDArray[np.float64]:
    """The rate of the bin of civil time, by day, by weekday or weekend, or by each weekday.

    ahead (m,): the slots to be predicted.
    Shrunk with the weight of `visits` full bins towards the histogram of the day, that to the mean.
    """
    weight = visits * bin_s / past.interval_s
    mean = (past.full.sum() + 0.5) / (past.seen.sum() + 1)
    rate = _rate(*past.by("day", bin_s), mean, weight)
    if kind != "day":
        rate = _rate(*past.by(kind, bin_s), rate, weight)
    days = np.broadcast_to(rate, (7, rate.shape[1]))
    return np.asarray(np.repeat(days, round(bin_s / SLOT_S), axis=1)[ahead // SLOTS, ahead % SLOTS])


def _together(counts: NDArray[np.float64], kind: Kind) -> NDArray[np.float64]:
    """(7, n) by weekday from the Thursday that time began on, days of one kind added up."""
    if kind == "day":
        return np.asarray(counts.sum(axis=0, keepdims=True))
    if kind == "weekend":
        return np.repeat([counts[:5].sum(axis=0), counts[5:].sum(axis=0)], (5, 2), axis=0)
    return counts


def _rate(
    seen: NDArray[np.float64], full: NDArray[np.float64], prior: NDArray[np.float64] | float, weight: float
) -> NDArray[np.float64]:
    return np.asarray((full + weight * prior) / (seen + weight))

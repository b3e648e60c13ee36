"""What `auto` has to beat: histograms of civil time, shrunk towards coarser ones. For evaluation only."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

Kind = Literal["day", "weekend", "weekday"]
KINDS: tuple[Kind, ...] = ("day", "weekend", "weekday")


def histogram(
    tau_s: NDArray[np.float64],
    state: NDArray[np.uint8],
    ahead_s: NDArray[np.float64],
    kind: Kind,
    bin_s: float = 1800.0,
    visits: float = 1.0,
) -> NDArray[np.float64]:
    """The rate of the bin of civil time, by day, by weekday or weekend, or by each weekday.

    tau_s, state (n,): the past, observed samples; ahead_s (m,): civil seconds to be predicted.
    Shrunk with the weight of `visits` full bins towards the histogram of the day, that to the mean.
    """
    n_bins = round(86_400 / bin_s)
    weight = visits * bin_s / float(np.median(np.diff(tau_s)))
    mean = (state.sum() + 0.5) / (state.size + 1)
    location, asked = (((each % 86_400) // bin_s).astype(int) for each in (tau_s, ahead_s))
    day = _rate(location, state, np.full(n_bins, mean), weight)
    if kind == "day":
        return np.asarray(day[asked])
    group, wanted = (_group(each, kind) for each in (tau_s, ahead_s))
    prior = np.tile(day, 7)
    return np.asarray(_rate(group * n_bins + location, state, prior, weight)[wanted * n_bins + asked])


def _group(tau_s: NDArray[np.float64], kind: Kind) -> NDArray[np.int64]:
    weekday = (tau_s // 86_400 % 7).astype(np.int64)
    return weekday if kind == "weekday" else (weekday >= 5).astype(np.int64)


def _rate(
    location: NDArray[np.int64], state: NDArray[np.uint8], prior: NDArray[np.float64], weight: float
) -> NDArray[np.float64]:
    seen = np.bincount(location, minlength=prior.size)
    full = np.bincount(location, state, minlength=prior.size)
    return np.asarray((full + weight * prior) / (seen + weight))

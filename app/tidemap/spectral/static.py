"""The `static` estimator: the mean alone, as a map without a sense of time has it."""

import numpy as np
from numpy.typing import NDArray

from tidemap.history.history import History
from tidemap.history.timebase import TimeBase
from tidemap.spectral import spectrum
from tidemap.spectral.spectrum import Spectrum


def observed_mean(n_occupied: NDArray[np.int64], n_observed: NDArray[np.int64]) -> NDArray[np.float32]:
    """The share of observed samples that were occupied, float32; NaN where none was observed."""
    share = np.full(n_observed.shape, np.nan, np.float64)
    np.divide(n_occupied, n_observed, out=share, where=n_observed > 0)
    return share.astype(np.float32)


def fit_static(history: History, order: int, base: TimeBase) -> Spectrum:
    """The mean of the observed samples; `order` is not used. One count of bits per cell."""
    mean = observed_mean(history.count_occupied(), history.count_observed())
    return spectrum.static(mean, float(base.time(history.start)))

"""The `static` estimator: the mean alone, as a map without a sense of time has it."""

import numpy as np
from numpy.typing import NDArray

from tidemap.history.history import History
from tidemap.history.timebase import TimeBase
from tidemap.spectral import spectrum
from tidemap.spectral.spectrum import Spectrum

HALF_VISIT = 0.5
"""Occupied and free visits that every cell is given before its first: Beta(1/2, 1/2), Jeffreys' prior."""


def expected_share(n_occupied: NDArray[np.int64], n_observed: NDArray[np.int64]) -> NDArray[np.float32]:
    """The share of samples that are occupied, half a visit of each state added; NaN where none was observed.

    Two readings, both occupied, make .83 of it and no certainty.

    >>> expected_share(np.array([2, 0, 0]), np.array([2, 1, 0])).tolist()
    [0.8333333134651184, 0.25, nan]
    """
    share = (n_occupied + HALF_VISIT) / (n_observed + 2 * HALF_VISIT)
    return np.where(n_observed > 0, share, np.nan).astype(np.float32)


def fit_static(history: History, order: int, base: TimeBase) -> Spectrum:
    """The expected share of the observed samples; `order` is not used. One count of bits per cell."""
    mean = expected_share(history.count_occupied(), history.count_observed())
    return spectrum.static(mean, base, float(base.time(history.start)))

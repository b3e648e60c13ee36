"""The amplitude of the day: how strongly p(t) of every cell goes up and down once in a day."""

import numpy as np
from numpy.typing import NDArray

from tidemap.spectral.prediction import predict
from tidemap.spectral.spectrum import Spectrum

HOURS = 24
HOUR_S = 3600.0


def day_amplitude(spectrum: Spectrum, start: float, threads: int = 1) -> NDArray[np.float32]:
    """The amplitude of the first harmonic of p over the day from `start` (Unix seconds), (n,) float32.

    It is of p as it is shown, at every hour, so it means the same for every estimator and link: 0 where all hours are
    alike, 2/π where one half of the day is surely occupied and the other surely free. NaN where never observed.
    Costs 24 predictions.
    """
    real, imaginary = np.zeros((2, spectrum.mean.size), np.float32)
    for hour in range(HOURS):
        p = predict(spectrum, start + hour * HOUR_S, threads=threads)
        phase = 2 * np.pi * hour / HOURS
        real += p * np.float32(np.cos(phase))
        imaginary += p * np.float32(np.sin(phase))
    return np.hypot(real, imaginary) * np.float32(2 / HOURS)

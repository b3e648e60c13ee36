"""The estimators by name."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from app.spectral.history import History
from app.spectral.spectrum import Spectrum
from app.spectral.static import fit_static
from app.spectral.timebase import TimeBase
from app.spectral.transform import fit_fft

Fit = Callable[[History, int, TimeBase], Spectrum]

ESTIMATORS: Mapping[str, Fit] = MappingProxyType({"fft": fit_fft, "static": fit_static})


def fit(history: History, estimator: str, order: int, base: TimeBase) -> Spectrum:
    """The spectrum of a history over its whole window; ValueError on an unknown estimator."""
    if estimator not in ESTIMATORS:
        raise ValueError(f"unknown estimator {estimator!r}; known are {', '.join(ESTIMATORS)}")
    return ESTIMATORS[estimator](history, order, base)

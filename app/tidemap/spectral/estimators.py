"""The estimators by name."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from tidemap.history.history import History
from tidemap.history.timebase import TimeBase
from tidemap.spectral.calendar.estimator import fit_calendar
from tidemap.spectral.recipe import Recipe
from tidemap.spectral.spectrum import Spectrum
from tidemap.spectral.static import fit_static
from tidemap.spectral.transform import fit_fft

Fit = Callable[[History, Recipe, TimeBase], Spectrum]

ESTIMATORS: Mapping[str, Fit] = MappingProxyType(
    {
        "calendar": fit_calendar,
        "fft": lambda history, recipe, base: fit_fft(history, recipe.order, base),
        "static": lambda history, recipe, base: fit_static(history, recipe.order, base),
    }
)


def fit_recipe(history: History, recipe: Recipe, base: TimeBase) -> Spectrum:
    """The spectrum of a history over its whole window; ValueError on an unknown estimator."""
    if recipe.estimator not in ESTIMATORS:
        raise ValueError(f"unknown estimator {recipe.estimator!r}; known are {', '.join(ESTIMATORS)}")
    return ESTIMATORS[recipe.estimator](history, recipe, base)


def fit(history: History, estimator: str, order: int, base: TimeBase) -> Spectrum:
    """As `fit_recipe` with nothing but a name and an order: `calendar` in UTC and with its usual priors."""
    return fit_recipe(history, Recipe(estimator, order), base)

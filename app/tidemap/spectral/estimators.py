"""The estimators by name."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TypeVar

from tidemap.history.history import History
from tidemap.history.timebase import TimeBase
from tidemap.spectral.calendar.estimator import fit_calendar
from tidemap.spectral.recipe import Recipe
from tidemap.spectral.spectrum import Spectrum, truncate
from tidemap.spectral.static import fit_static
from tidemap.spectral.transform import fit_fft

Key = TypeVar("Key")
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


def fit_all(
    history: History, recipes: Mapping[Key, Recipe], base: TimeBase, check: Callable[[], None] = lambda: None
) -> dict[Key, Spectrum]:
    """Every recipe's spectrum, by the same keys; `fft` is fitted once, its smaller orders are the first components.

    `check` is called before each; what it raises ends the fitting.
    """
    orders = [recipe.order for recipe in recipes.values() if recipe.estimator == "fft"]
    largest = fit_fft(history, max(orders), base) if orders else None
    fits: dict[Key, Spectrum] = {}
    for key, recipe in recipes.items():
        check()
        if largest is not None and recipe.estimator == "fft":
            fits[key] = truncate(largest, recipe.order)
        else:
            fits[key] = fit_recipe(history, recipe, base)
    return fits


def fit(history: History, estimator: str, order: int, base: TimeBase) -> Spectrum:
    """As `fit_recipe` with nothing but a name and an order: `calendar` in UTC and with its usual priors."""
    return fit_recipe(history, Recipe(estimator, order), base)

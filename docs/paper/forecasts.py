"""Forecasts: what `auto`, single estimators and histograms of civil time expect of later samples."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from tests.unit.spectral.rivals import KINDS, Tally, histogram, slots
from tidemap.history.history import UNOBSERVED, History
from tidemap.history.timebase import TimeBase
from tidemap.spectral.auto.selection import choose
from tidemap.spectral.civil import civil_seconds
from tidemap.spectral.estimators import fit_recipe
from tidemap.spectral.prediction import predict_times
from tidemap.spectral.recipe import Recipe
from tidemap.spectral.window import fit_window

Samples = NDArray[np.int64]
Probability = NDArray[np.floating]
ORDERS = tuple(range(1, 21))
BINS_S = (900.0, 1800.0, 3600.0)
VISITS = (0.3, 1.0, 3.0)


def automatic(past: History, base: TimeBase, time_zone: str, ahead: Samples, estimator: str = "auto") -> Probability:
    """What is chosen on the past alone expects, (n_cells, n_times)."""
    return with_recipe(past, base, choose(past, base, time_zone=time_zone, estimator=estimator).recipe, ahead)


def with_recipe(past: History, base: TimeBase, recipe: Recipe, ahead: Samples) -> Probability:
    """The same by a given recipe; `fft` is fitted to whole days or weeks."""
    window = (past.start, past.stop)
    if recipe.estimator == "fft":
        window = fit_window(*window, base.interval_s)
    return predict_times(fit_recipe(past.window(*window), recipe, base), base.time(ahead))


def histograms(past: History, base: TimeBase, time_zone: str, ahead: Samples) -> Iterator[tuple[str, Probability]]:
    """Of the only cell: by day, weekend and weekday, of every width and shrinkage; the name begins with the kind."""
    states = past.states()[0]
    known = np.flatnonzero(states != UNOBSERVED)
    seen = Tally.of(civil_seconds(base.time(past.start + known), time_zone), states[known])
    wanted = slots(civil_seconds(base.time(ahead), time_zone))
    for kind in KINDS:
        for bin_s in BINS_S:
            for visits in VISITS:
                yield f"{kind} {bin_s:g} {visits:g}", histogram(seen, wanted, kind, bin_s, visits)

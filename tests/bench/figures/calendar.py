"""calendar: the fit of every changing cell of a grid, against the matrix products it cannot do without."""

import numpy as np

from tests.bench.figures.update import BASE, changing_cells
from tests.bench.timing import Figure, interleaved
from tidemap.history.history import History
from tidemap.spectral.calendar import folding, waves
from tidemap.spectral.estimators import fit_recipe
from tidemap.spectral.model import refit
from tidemap.spectral.recipe import Recipe

N_CELLS, ROWS, STEPS = 2048, 64, 12
RECIPE = Recipe("calendar", time_zone="Europe/London")


def measure() -> Figure:
    """Floor: two products of 64 rows with the widest design in each of twelve steps. The goal is 200 µs."""
    history = History.from_states(changing_cells()[:N_CELLS])
    design = waves.design(folding.slot_offset_s(BASE))
    transposed, rows = np.ascontiguousarray(design.T), np.ones((ROWS, design.shape[0]), np.float32)

    def products() -> None:
        for _ in range(N_CELLS // ROWS * STEPS):
            (rows @ design) @ transposed

    def fits() -> None:
        fit_recipe(history, RECIPE, BASE)

    def whole() -> None:
        refit(history, RECIPE, BASE)

    floor, value, updated = interleaved(products, fits, whole, rounds=3)
    micro = 1e6 / N_CELLS
    details = {"cells": N_CELLS, "samples": history.n_samples, "priors": len(RECIPE.priors), "goal": 200}
    return Figure(value * micro, floor * micro, 2.0, "µs/cell", {**details, "update": round(updated * micro, 1)})

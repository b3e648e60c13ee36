"""selection: `auto` on a grid and on a single state, against one fit of the cells it tries."""

from tests.bench.figures.update import BASE, changing_cells
from tests.bench.timing import Figure, interleaved
from tidemap.history.history import History
from tidemap.spectral.auto.selection import choose
from tidemap.spectral.estimators import fit_recipe
from tidemap.spectral.recipe import Recipe

N_CELLS, ZONE = 64, "Europe/London"


def measure() -> Figure:
    history = History.from_states(changing_cells()[:N_CELLS])
    one = history.cells([0])
    chosen = choose(history, BASE, time_zone=ZONE)
    tried = history.cells(range(chosen.cells))

    def fits() -> None:
        fit_recipe(tried, Recipe("calendar", time_zone=ZONE), BASE)

    def grid() -> None:
        choose(history, BASE, time_zone=ZONE)

    def state() -> None:
        choose(one, BASE, time_zone=ZONE)

    floor, value, single = interleaved(fits, grid, state, rounds=3)
    details = {
        "cells": chosen.cells,
        "candidates": len(chosen.table),
        "ms_per_cell": round(value * 1e3 / chosen.cells, 1),
        "state_ms": round(single * 1e3, 1),
    }
    return Figure(value * 1e3, floor * 1e3, 500.0, "ms", details)

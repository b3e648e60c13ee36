"""year: the update of cells with a year of five-minute samples, against reading their bits once."""

import tracemalloc

import numpy as np

from tests.bench.figures.update import BASE
from tests.bench.timing import Figure, interleaved
from tidemap.history.history import History
from tidemap.spectral.model import refit
from tidemap.spectral.recipe import Recipe

N_CELLS, N_SAMPLES = 512, 105_120
RECIPE = Recipe("calendar", time_zone="Europe/London")


def year_of_cells(n_cells: int = N_CELLS) -> History:
    """Cells that are occupied for a part of every day, with 5 % noise, and unobserved for a tenth of the time."""
    random = np.random.default_rng(1)
    hour = (np.arange(N_SAMPLES) / 12) % 24
    begin, length = random.uniform(0, 24, (n_cells, 1)), random.uniform(2, 12, (n_cells, 1))
    planes = [np.empty((n_cells, N_SAMPLES // 8), np.uint8) for _ in range(2)]
    for cell in range(n_cells):
        full = ((hour - begin[cell]) % 24 < length[cell]) ^ (random.random(N_SAMPLES, np.float32) < 0.05)
        seen = np.repeat(random.random(N_SAMPLES // 96 + 1) < 0.9, 96)[:N_SAMPLES]
        for plane, bits in zip(planes, (seen, seen & full), strict=True):
            plane[cell] = np.packbits(bits, bitorder="little")
    return History(0, N_SAMPLES, *planes)


def measure() -> Figure:
    history = year_of_cells()

    def read() -> None:
        history.count_observed()
        history.count_occupied()

    def whole() -> None:
        refit(history, RECIPE, BASE)

    floor, value = interleaved(read, whole, rounds=3)
    tracemalloc.start()
    whole()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    held = history.observed.nbytes + history.occupied.nbytes
    details = {"cells": N_CELLS, "samples": N_SAMPLES, "peak_mb": round(peak / 1e6), "history_mb": round(held / 1e6)}
    return Figure(value / N_CELLS * 1e6, floor / N_CELLS * 1e6, 20.0, "µs/cell", details)

"""given: the probability of every cell of a large grid, given its last reading, against the same without (DESIGN 2.8).

The cells were read in 1,000 looks of a thousand neighbours each, and had lasted for some time that differs from look to
look; `every_cell_apart` is where no two neighbours were read alike.
"""

import numpy as np

from tests.bench.figures.predict import N_CELLS, grid
from tests.bench.timing import Figure, interleaved
from tidemap.spectral.conditioning import UNLEARNED, Evidence
from tidemap.spectral.prediction import predict

LOOK, NOW_S = 1000, 1e6


def measure() -> Figure:
    spectrum, random = grid(), np.random.default_rng(4)
    look = np.repeat(np.arange(N_CELLS // LOOK), LOOK)
    alike = evidence(
        random.integers(0, 900_000, N_CELLS // LOOK)[look], random.integers(1, 9999, N_CELLS // LOOK)[look]
    )
    apart = evidence(random.integers(0, 900_000, N_CELLS), random.integers(1, 9999, N_CELLS))
    sample = spectrum.base.sample([NOW_S])

    def given(known: Evidence) -> None:
        known.condition(predict(spectrum, NOW_S)[:, np.newaxis], sample, 1.0, UNLEARNED)

    floor, value, worst = interleaved(lambda: predict(spectrum, NOW_S), lambda: given(alike), lambda: given(apart))
    details = {"cells": N_CELLS, "every_cell_apart": round(worst * 1e3, 2), "bytes_a_cell": alike.nbytes / N_CELLS}
    return Figure(value * 1e3, floor * 1e3, 1.3, "ms", details)


def evidence(sample: np.ndarray, age: np.ndarray) -> Evidence:
    """The readings of all cells, half of them occupied."""
    state = (np.arange(N_CELLS) % 2).astype(np.uint8)
    return Evidence(state, sample.astype(np.int64), age.astype(np.uint32), np.full(N_CELLS, 0.6, np.float32))

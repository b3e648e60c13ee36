"""given: the probability of every cell of a large grid, given its last reading, against the same without (DESIGN 2.8).

The cells were read in 1,000 looks of a thousand neighbours each, and had lasted for some time that differs from look to
look; `every_cell_apart` is where no two neighbours were read alike, `a_sensor_that_errs` the same by beliefs.
"""

import numpy as np

from tests.bench.figures.predict import N_CELLS, grid
from tests.bench.timing import Figure, interleaved
from tidemap.spectral.belief import Beliefs
from tidemap.spectral.conditioning import UNLEARNED, Evidence
from tidemap.spectral.detector import Detector
from tidemap.spectral.durations import Durations
from tidemap.spectral.prediction import predict
from tidemap.spectral.sensor import Sensor

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

    believed = beliefs(apart)

    def sensed() -> None:
        believed.condition(predict(spectrum, NOW_S)[:, np.newaxis], sample)

    floor, value, worst, erring = interleaved(
        lambda: predict(spectrum, NOW_S), lambda: given(alike), lambda: given(apart), sensed
    )
    details = {
        "cells": N_CELLS,
        "every_cell_apart": round(worst * 1e3, 2),
        "a_sensor_that_errs": round(erring * 1e3, 2),
        "bytes_a_cell": alike.nbytes / N_CELLS,
    }
    return Figure(value * 1e3, floor * 1e3, 1.3, "ms", details)


def beliefs(read: Evidence) -> Beliefs:
    """What is believed of cells that were read then by a sensor that errs."""
    detector = Detector(Sensor(0.1, 0.1), Durations.believed(1.0))
    age = np.minimum(8 * read.age, 2**16 - 1).astype(np.uint16)
    signed = np.where(read.state == 1, 0.9, -0.1).astype(np.float32)
    return Beliefs(detector, signed, read.sample, read.q, np.stack((age, age[::-1])))


def evidence(sample: np.ndarray, age: np.ndarray) -> Evidence:
    """The readings of all cells, half of them occupied."""
    state = (np.arange(N_CELLS) % 2).astype(np.uint8)
    return Evidence(state, sample.astype(np.int64), age.astype(np.uint32), np.full(N_CELLS, 0.6, np.float32))

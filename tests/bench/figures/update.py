"""update: history to spectrum and outliers, against the bare transform of the same samples."""

import numpy as np
import scipy.fft

from tests.bench.timing import Figure, interleaved
from tidemap.history.history import History
from tidemap.history.timebase import TimeBase
from tidemap.spectral.model import accuracy, update

N_CELLS, N_SAMPLES, ORDER, ROWS = 20_000, 2016, 15, 256
BASE = TimeBase(epoch=0.0, interval_s=300.0)


def changing_cells() -> np.ndarray:
    """Cells that are occupied for a part of every day, each at its own hours, with 5 % noise."""
    random = np.random.default_rng(1)
    hour = (np.arange(N_SAMPLES) / 12) % 24
    begin, length = random.uniform(0, 24, (N_CELLS, 1)), random.uniform(2, 12, (N_CELLS, 1))
    states = ((hour - begin) % 24 < length).astype(np.uint8)
    return states ^ (random.random(states.shape, np.float32) < 0.05)


def measure() -> Figure:
    states = changing_cells()
    history, signal = History.from_states(states), states.astype(np.float32)

    def bare() -> None:
        for first in range(0, N_CELLS, ROWS):
            scipy.fft.rfft(signal[first : first + ROWS], axis=1)

    def whole() -> None:
        update(history, "fft", ORDER, BASE)

    floor, value = interleaved(bare, whole)
    model = update(history, "fft", ORDER, BASE)
    details = {
        "cells": N_CELLS,
        "samples": N_SAMPLES,
        "order": ORDER,
        "threads": 1,
        "accuracy": round(accuracy(model), 4),
        "intervals_a_cell": round(model.outliers.start.size / N_CELLS, 1),
    }
    return Figure(value / N_CELLS * 1e6, floor / N_CELLS * 1e6, 3.0, "µs/cell", details)

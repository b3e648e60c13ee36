"""predict: the probability of every cell of a large grid at one time, against copying its coefficients."""

import numpy as np

from tests.bench.timing import Figure, interleaved
from tidemap.history.timebase import TimeBase
from tidemap.spectral.prediction import predict
from tidemap.spectral.spectrum import Spectrum

N_CELLS, N_WAVES, ORDER, WEEK_S = 1_000_000, 1008, 15, 604_800.0


def grid(n_waves: int = N_WAVES, order: int = ORDER) -> Spectrum:
    """Every cell with frequencies of its own among the bins of a week of five-minute samples."""
    random = np.random.default_rng(2)
    parts = random.standard_normal((N_CELLS, order, 2), np.float32) * np.float32(0.05)
    return Spectrum(
        link="identity",
        origin_s=0.0,
        time_zone=None,
        frequency_hz=np.arange(1, n_waves + 1) / WEEK_S,
        gate=np.zeros(n_waves, np.uint8),
        mean=random.random(N_CELLS, np.float32),
        cell=np.arange(N_CELLS, dtype=np.int32),
        index=random.integers(0, n_waves, (N_CELLS, order), np.uint16),
        coefficient=parts.view(np.complex64)[:, :, 0],
        base=TimeBase(0.0, 1.0),
    )


def measure() -> Figure:
    return beside_copying(grid())


def beside_copying(spectrum: Spectrum) -> Figure:
    """Floor: the index and the coefficients of all cells copied once."""
    index, coefficient = np.empty_like(spectrum.index), np.empty_like(spectrum.coefficient)

    def copy() -> None:
        np.copyto(index, spectrum.index)
        np.copyto(coefficient, spectrum.coefficient)

    def one() -> None:
        predict(spectrum, 1e6)

    def two() -> None:
        predict(spectrum, 1e6, threads=2)

    floor, value, threaded = interleaved(copy, one, two)
    details = {"cells": N_CELLS, "order": spectrum.order, "threads": 1, "two_threads": round(threaded * 1e3, 2)}
    return Figure(value * 1e3, floor * 1e3, 2.0, "ms", details)

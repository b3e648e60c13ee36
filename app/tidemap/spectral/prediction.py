"""Prediction: the probability of any cell at any time, and what is said from it (Eq. 3)."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from math import ceil
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tidemap.history.sequences import Sequences
from tidemap.history.timebase import TimeBase
from tidemap.spectral import kernels
from tidemap.spectral.spectrum import Spectrum, check_cells, compact, gates, select, tau

VERDICTS: Final = ("free", "occupied", "uncertain")
FREE_VERDICT: Final = 0
OCCUPIED_VERDICT: Final = 1
UNCERTAIN_VERDICT: Final = 2

TABLE_SIZE = 1 << 20
"""Entries of a table of phasors that are held at a time."""
WORTHWHILE = 1 << 22
"""Coefficients from which on another thread is worth being started: 3 ms of work."""


def predict(spectrum: Spectrum, time: float, cells: ArrayLike | None = None, threads: int = 1) -> NDArray[np.float32]:
    """p(t) of all or of the given cells at one time (Unix seconds), (n,) float32.

    Clipped to [0, 1], NaN where never observed. One phasor per wave in float64, then one gather
    per coefficient: 1-2 ns each. IndexError on a cell out of range.
    """
    phasor = phasors(spectrum, np.array([time], np.float64))[:, 0].copy()
    waves = (spectrum.cell, spectrum.index, spectrum.coefficient, phasor)
    if cells is not None:
        chosen = check_cells(spectrum, cells)
        out = spectrum.mean[chosen]
        kernels.add_waves_of(chosen, *waves, out)
    else:
        out = spectrum.mean.copy()

        def add(part: slice) -> None:
            kernels.add_waves(spectrum.cell[part], spectrum.index[part], spectrum.coefficient[part], phasor, out)

        share_rows(spectrum.cell.size, spectrum.order, threads, add)
    return probability(spectrum, out)


def known(spectrum: Spectrum) -> NDArray[np.int64]:
    """The cells that have been observed, ascending."""
    return np.flatnonzero(~np.isnan(spectrum.mean))


def share_rows(n_rows: int, cost: float, threads: int, work: Callable[[slice], None]) -> None:
    """Rows are shared out among threads; every row goes to one of them. cost: of a row, in coefficients."""
    step = max(-(-n_rows // max(1, threads)), ceil(WORTHWHILE / max(1, cost)))
    parts = [slice(first, min(first + step, n_rows)) for first in range(0, n_rows, step)]
    if len(parts) <= 1:
        for part in parts:
            work(part)
        return
    with ThreadPoolExecutor(len(parts)) as pool:
        list(pool.map(work, parts))


def predict_times(spectrum: Spectrum, time: ArrayLike, cells: ArrayLike | None = None) -> NDArray[np.float32]:
    """p(t) of all or of the given cells at many times, (n_cells, n_times) float32.

    As `predict`; the phasors of the waves the cells use are tabulated for a block of times.
    """
    chosen = compact(spectrum if cells is None else select(spectrum, cells))
    times = np.asarray(time, np.float64)
    out = np.repeat(chosen.mean[:, np.newaxis], times.size, axis=1)
    step = max(1, TABLE_SIZE // max(1, chosen.n_waves))
    for first in range(0, times.size if chosen.n_waves else 0, step):
        block = np.ascontiguousarray(out[:, first : first + step])
        phasor = phasors(chosen, times[first : first + step])
        kernels.add_waves_over_time(chosen.cell, chosen.index, chosen.coefficient, phasor, block)
        out[:, first : first + step] = block
    return probability(chosen, out)


def predict_readings(spectrum: Spectrum, cells: ArrayLike, sequences: Sequences, base: TimeBase) -> NDArray[np.float32]:
    """p(t) at every reading of the given cells, one float32 a reading, in their order; a block of times at once."""
    chosen = compact(select(spectrum, cells))
    times, column = np.unique(sequences.sample, return_inverse=True)
    out = np.repeat(chosen.mean, sequences.count)
    step = max(1, TABLE_SIZE // max(1, chosen.n_waves))
    for first in range(0, times.size if chosen.n_waves else 0, step):
        phasor = phasors(chosen, base.time(times[first : first + step]))
        begins, ends = (_passed(sequences, column, number) for number in (first, first + step))
        waves = (chosen.cell, chosen.index, chosen.coefficient, phasor)
        kernels.add_waves_at(begins, ends, column - first, *waves, out)
    return probability(chosen, out)


def _passed(sequences: Sequences, column: NDArray[np.int64], number: int) -> NDArray[np.int64]:
    """(n,) of every cell the first reading whose column is `number` or later."""
    earlier = np.concatenate((np.zeros(1, np.int64), np.cumsum(column < number)))
    return np.asarray(sequences.offset[:-1] + np.diff(earlier[sequences.offset]), np.int64)


def predict_slow(spectrum: Spectrum, time: ArrayLike, cells: ArrayLike | None = None) -> NDArray[np.float64]:
    """p(t) by the direct sum in float64, (n_cells, n_times): the truth the fast paths are held to."""
    chosen = spectrum if cells is None else select(spectrum, cells)
    tau_s = tau(chosen, np.atleast_1d(np.asarray(time, np.float64)))
    wave = np.exp(2j * np.pi * chosen.frequency_hz[:, np.newaxis] * tau_s) * gates(chosen, tau_s)
    value = np.repeat(chosen.mean.astype(np.float64)[:, np.newaxis], tau_s.size, axis=1)
    for cell, index, coefficient in zip(chosen.cell, chosen.index, chosen.coefficient, strict=True):
        value[cell] += 2 * (coefficient.astype(np.complex128)[:, np.newaxis] * wave[index]).sum(axis=0).real
    if chosen.link == "logit":
        return np.asarray(1 / (1 + np.exp(-value)))
    return np.clip(value, 0.0, 1.0)


def phasors(spectrum: Spectrum, time: NDArray[np.float64]) -> NDArray[np.complex64]:
    """2 · gate(t) · exp(2πi · frequency · τ(t)), (n_waves, n_times) complex64, computed in float64."""
    return tau_phasors(spectrum, tau(spectrum, time))


def tau_phasors(spectrum: Spectrum, tau_s: NDArray[np.float64]) -> NDArray[np.complex64]:
    """The same at times that are given as τ."""
    table = np.empty((spectrum.n_waves, tau_s.size), np.complex64)
    kernels.unit_phasors(spectrum.frequency_hz, tau_s, table)
    table *= np.float32(2)
    if spectrum.gate.any():
        table *= gates(spectrum, tau_s)
    return table


def probability(spectrum: Spectrum, value: NDArray[np.float32]) -> NDArray[np.float32]:
    """link⁻¹ of a value on the scale of the link, clipped to [0, 1]; works in `value`, NaN stays."""
    if spectrum.link == "logit":
        np.clip(value, -80, 80, out=value)
        np.negative(value, out=value)
        np.exp(value, out=value)
        value += np.float32(1)
        np.reciprocal(value, out=value)
        return value
    return np.asarray(np.clip(value, 0, 1, out=value))


def state(probability: ArrayLike, confidence: ArrayLike = 0.5) -> NDArray[np.uint8]:
    """s'(t, c) = p(t) > c (Eq. 3), uint8; 0 where p is NaN."""
    return np.asarray(np.asarray(probability) > confidence, np.uint8)


def verdict(probability: ArrayLike, confidence: ArrayLike) -> NDArray[np.uint8]:
    """Codes into VERDICTS: occupied for p > c, else free for p < 1 - c, else uncertain (also NaN).

    >>> [VERDICTS[code] for code in verdict([0.05, 0.5, 0.95], 0.9)]
    ['free', 'uncertain', 'occupied']
    """
    p, c = np.asarray(probability), np.asarray(confidence, np.float64)
    # At the precision of p, as `state` compares.
    precision = np.result_type(p, np.float16)
    occupied, free = np.asarray(p > c.astype(precision)), np.asarray(p < (1 - c).astype(precision))
    uncertain = ~(occupied | free)
    return np.asarray(uncertain.view(np.uint8) * np.uint8(UNCERTAIN_VERDICT) + occupied.view(np.uint8))


def entropy(probability: ArrayLike) -> NDArray[np.float64]:
    """The entropy of the state in bits, 0 where certain, 1 at p = 0.5, NaN where p is.

    >>> entropy([0.0, 0.5, 1.0]).tolist()
    [0.0, 1.0, 0.0]
    """
    p = np.asarray(probability, np.float64)
    both = np.stack((p, 1 - p))
    bits = np.zeros_like(both)
    np.log2(both, out=bits, where=both > 0)
    return np.asarray(np.where(np.isnan(p), np.nan, np.abs((both * bits).sum(axis=0))))

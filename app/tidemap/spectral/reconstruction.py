"""Reconstruction: the thresholded prediction s'(t) at every sample of a span, as words of bits.

Computed in blocks of 64 samples that start at multiples of 64, so the value of a sample is the
same bit for bit whichever span it was asked with: what was stored as an outlier of s' is one.
"""

import numpy as np
from numpy.typing import NDArray

from tidemap.history.bits import ALL, WORD, blocks
from tidemap.history.timebase import TimeBase
from tidemap.spectral import kernels, weekly
from tidemap.spectral.prediction import TABLE_SIZE, phasors, tau_phasors
from tidemap.spectral.spectrum import Spectrum

ROWS = 256


def predicted_words(spectrum: Spectrum, base: TimeBase, start: int, stop: int) -> NDArray[np.uint64]:
    """(p > 0.5) of the blocks that cover samples [start, stop), (n_cells, n_blocks) uint64.

    Bit b of word w is sample 64 (start // 64 + w) + b; cells never observed are predicted free.
    """
    first, last = blocks(start, stop)
    threshold = 0.0 if spectrum.link == "logit" else 0.5
    words = np.zeros((spectrum.n_cells, last - first), np.uint64)
    words[spectrum.mean > threshold] = ALL
    if spectrum.cell.size and spectrum.order:
        if spectrum.time_zone is None and not spectrum.gate.any():
            _fill_uniform(spectrum, base, first, threshold, words)
        elif week := weekly.clock(spectrum, base):
            weekly.fill_weekly(spectrum, base, week, first, threshold, words)
        else:
            _fill(spectrum, base, first, threshold, words)
    return words


def _fill_uniform(spectrum: Spectrum, base: TimeBase, first: int, threshold: float, words: NDArray[np.uint64]) -> None:
    """τ advances evenly: two small tables, of the middles of the blocks and of the way from there."""
    away = np.arange(0.5, WORD // 2) * base.interval_s
    phasor = np.empty((spectrum.n_waves, away.size), np.complex64)
    kernels.unit_phasors(spectrum.frequency_hz, away, phasor)
    offset = np.concatenate((phasor.real, phasor.imag), axis=1)
    step = max(1, TABLE_SIZE // spectrum.n_waves)
    for block in range(0, words.shape[1], step):
        part = np.ascontiguousarray(words[:, block : block + step])
        middle = base.time((first + block + np.arange(part.shape[1])) * WORD + (WORD - 1) / 2)
        anchor = tau_phasors(spectrum, middle - spectrum.origin_s)
        waves = (spectrum.cell, spectrum.index, spectrum.coefficient, spectrum.mean)
        kernels.threshold_blocks(*waves, threshold, anchor, offset, part)
        words[:, block : block + step] = part


def _fill(spectrum: Spectrum, base: TimeBase, first: int, threshold: float, words: NDArray[np.uint64]) -> None:
    """τ jumps or waves come and go: a phasor for every wave and sample."""
    step = max(1, TABLE_SIZE // (WORD * spectrum.n_waves))
    mean = spectrum.mean[spectrum.cell]
    rows = np.arange(spectrum.cell.size, dtype=np.int32)
    for block in range(0, words.shape[1], step):
        n_samples = WORD * min(step, words.shape[1] - block)
        phasor = phasors(spectrum, base.time((first + block) * WORD + np.arange(n_samples)))
        for row in range(0, rows.size, ROWS):
            some = slice(row, row + ROWS)
            value = np.repeat(mean[some, np.newaxis], n_samples, axis=1)
            waves = (rows[: value.shape[0]], spectrum.index[some], spectrum.coefficient[some])
            kernels.add_waves_over_time(*waves, phasor, value)
            over = np.packbits(value > threshold, axis=1, bitorder="little").view(np.uint64)
            words[spectrum.cell[some], block : block + over.shape[1]] = over

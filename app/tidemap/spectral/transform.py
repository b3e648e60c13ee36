"""The `fft` estimator: the paper's spectrum, P = FT(s(t)) and its `order` greatest coefficients."""

from dataclasses import replace

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from tidemap.history.history import History
from tidemap.history.timebase import TimeBase
from tidemap.spectral import choosing
from tidemap.spectral.spacing import spacing
from tidemap.spectral.spectrum import Spectrum, index_type, static
from tidemap.spectral.static import HALF_VISIT, expected_share

BATCH_ROWS = 64
BATCH_SAMPLES = 1 << 20


def fit_fft(history: History, order: int, base: TimeBase) -> Spectrum:
    """The mean, not counted, and the `order` coefficients of greatest magnitude per cell (II-B 1).

    With mask 1 where observed, N observed samples and their mean m, coefficient k is
    FFT(mask · (s - m))_k / N = (F[mask · s]_k - m F[mask]_k) / N: the plain FFT / T where all is
    observed, while unobserved samples say nothing. Half a visit of each state is added: p(t) is drawn
    towards 1/2 by N / (N + 1), which keeps every s'(t) = p(t) > 1/2. Frequencies that the spacing of a
    cell's observations confuses with lower ones are left out (`spacing`). Of a pair of conjugate bins one is kept and
    counted twice by the formula of p(t); the Nyquist bin of an even length is alone and halved.
    Bin k has the frequency k / (n_samples interval_s); phases count from the window's first sample, start to start.
    Cells whose observed samples agree get no waves and are found by counting bits.

    Cost per varying cell is a float32 FFT of n_samples and one pass over its bins; a prime
    n_samples takes several times as long. ValueError on a negative order.
    """
    if order < 0:
        raise ValueError(f"order must not be negative: {order}")
    n_observed, n_occupied = history.count_observed(), history.count_occupied()
    means = static(expected_share(n_occupied, n_observed), base, float(base.time(history.start)))
    varying = np.flatnonzero((n_occupied > 0) & (n_occupied < n_observed))
    if order == 0 or varying.size == 0:
        return means
    bins, coefficient = _top_k(
        history, varying, (n_occupied / np.maximum(n_observed, 1)).astype(np.float32), n_observed, order
    )
    used = np.zeros(history.n_samples // 2 + 1, np.bool_)
    choosing.mark(bins, used)
    used[0] = False
    wave = np.flatnonzero(used)
    if wave.size == 0:
        return means
    position = np.maximum(np.cumsum(used) - 1, 0).astype(index_type(wave.size))
    return replace(
        means,
        frequency_hz=wave / (history.n_samples * base.interval_s),
        gate=np.zeros(wave.size, np.uint8),
        cell=varying.astype(np.int32),
        index=position[bins],
        coefficient=coefficient,
    )


def _top_k(
    history: History,
    varying: NDArray[np.int64],
    mean: NDArray[np.float32],
    n_observed: NDArray[np.int64],
    order: int,
) -> tuple[NDArray[np.int32], NDArray[np.complex64]]:
    """Bins and coefficients (n_varying, order) of the varying cells, zeros where there are fewer."""
    bins = np.zeros((varying.size, order), np.int32)
    coefficient = np.zeros((varying.size, order), np.complex64)
    n_samples = history.n_samples
    n_rows = max(1, min(BATCH_ROWS, BATCH_SAMPLES // n_samples, varying.size))
    signal = np.empty((n_rows, n_samples), np.float32)
    scale = (1 / (n_observed[varying] + 2 * HALF_VISIT)).astype(np.float32)
    limit = _bins_resolved(spacing(history, varying), n_samples)
    for first in range(0, varying.size, n_rows):
        batch = slice(first, first + n_rows)
        rows = varying[batch]
        choosing.unpack(history.observed, history.occupied, rows, mean, signal[: rows.size])
        transform = scipy.fft.rfft(signal[: rows.size], axis=1)
        choosing.top_k(transform, scale[batch], limit[batch], n_samples % 2 == 0, bins[batch], coefficient[batch])
    return bins, coefficient


def _bins_resolved(apart: NDArray[np.float64], n_samples: int) -> NDArray[np.int64]:
    """How many of the bins 0, 1, … observations so far apart tell from one another: all where every sample may be one.

    The bin of half a cycle a spacing is its own alias, but for the last bin of all, which `top_k` halves.
    """
    resolved = np.ceil(n_samples / (2 * apart)).astype(np.int64)
    return np.where(apart > 1, resolved, n_samples // 2 + 1)

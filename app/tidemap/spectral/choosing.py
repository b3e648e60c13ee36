"""Kernels that choose coefficients: the samples of a transform, and the greatest of its bins."""

import numpy as np
from numpy.typing import NDArray

from tidemap.history.jit import kernel

CHUNK = 16
"""Bins looked at together; most chunks hold none of the greatest and cost one comparison."""


@kernel
def unpack(
    observed: NDArray[np.uint8],
    occupied: NDArray[np.uint8],
    row: NDArray[np.int64],
    mean: NDArray[np.float32],
    out: NDArray[np.float32],
) -> None:
    """out (n, n_samples): s - mean of the cells `row`, zero where unobserved."""
    n_samples = out.shape[1]
    for i in range(row.size):
        cell, shift = row[i], mean[row[i]]
        for byte in range(n_samples >> 3):
            observed_byte, occupied_byte = observed[cell, byte], occupied[cell, byte]
            for bit in range(8):
                value = np.float32((occupied_byte >> bit) & 1) - shift
                out[i, 8 * byte + bit] = value * np.float32((observed_byte >> bit) & 1)
        for sample in range(n_samples & ~7, n_samples):
            observed_byte, occupied_byte = observed[cell, sample >> 3], occupied[cell, sample >> 3]
            value = np.float32((occupied_byte >> (sample & 7)) & 1) - shift
            out[i, sample] = value * np.float32((observed_byte >> (sample & 7)) & 1)


@kernel
def top_k(
    bins: NDArray[np.complex64],
    scale: NDArray[np.float32],
    limit: NDArray[np.int64],
    nyquist: bool,
    index: NDArray[np.int32],
    coefficient: NDArray[np.complex64],
) -> None:
    """Of every row the bins of greatest magnitude, descending, of equal ones the lower frequency first.

    bins (n, n_bins) with DC at 0, which is left out, as are those from limit (n,) on; index, coefficient
    (n, order), zero where the row has fewer. With `nyquist` the last bin is its own conjugate and counts half.
    """
    n_bins, order = bins.shape[1], index.shape[1]
    size = -(-n_bins // CHUNK) * CHUNK
    power = np.zeros(size, np.float32)
    key = power.view(np.int32)
    best = np.empty(order, np.int32)
    for row in range(bins.shape[0]):
        power[limit[row] :] = np.float32(0)
        for k in range(1, limit[row]):
            value = bins[row, k]
            power[k] = value.real * value.real + value.imag * value.imag
        if nyquist and limit[row] == n_bins:
            power[n_bins - 1] *= np.float32(0.25)
        best[:] = 0
        for first in range(0, size, CHUNK):
            top = key[first]
            for k in range(first, first + CHUNK):
                top = max(top, key[k])
            if top <= best[order - 1]:
                continue
            for k in range(first, first + CHUNK):
                if key[k] > best[order - 1]:
                    location = order - 1
                    while location > 0 and best[location - 1] < key[k]:
                        best[location] = best[location - 1]
                        index[row, location] = index[row, location - 1]
                        location -= 1
                    best[location] = key[k]
                    index[row, location] = k
        for location in range(order):
            if best[location] > 0:
                k = index[row, location]
                factor = scale[row] * np.float32(0.5 if nyquist and k == n_bins - 1 else 1.0)
                coefficient[row, location] = bins[row, k] * factor


@kernel
def mark(index: NDArray[np.int32], used: NDArray[np.bool_]) -> None:
    for row in range(index.shape[0]):
        for location in range(index.shape[1]):
            used[index[row, location]] = True

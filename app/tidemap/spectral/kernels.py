"""Kernels that evaluate coefficients at one time or at every sample."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tidemap.history.bits import WORD
from tidemap.history.jit import fused_kernel, kernel

Index = NDArray[np.uint16] | NDArray[np.uint32]

HALF = WORD // 2

NEAR = 4
"""Rows that are looked at one by one before steps get longer."""
GATHER_BITS = np.uint64(0x0102040810204080)
"""Times eight bytes of 0 or 1, this has them as the bits of its highest byte."""


@kernel
def summed(index: Any, coefficient: Any, phasor: Any) -> Any:
    """Re Σ coefficient · phasor[index] of one cell; its two parts are summed apart, which makes one step of both."""
    real, imaginary = np.float32(0), np.float32(0)
    for column in range(index.size):
        wave, value = phasor[index[column]], coefficient[column]
        real += value.real * wave.real
        imaginary += value.imag * wave.imag
    return real - imaginary


@kernel
def add_waves(
    cell: NDArray[np.int32],
    index: Index,
    coefficient: NDArray[np.complex64],
    phasor: NDArray[np.complex64],
    out: NDArray[np.float32],
) -> None:
    """out[cell] += Re Σ coefficient · phasor[index]; phasor (n_waves,) carries the factor 2 and the gate."""
    for row in range(cell.size):
        out[cell[row]] += summed(index[row], coefficient[row], phasor)


@kernel
def values(
    mean: NDArray[np.float32],
    cell: NDArray[np.int32],
    index: Index,
    coefficient: NDArray[np.complex64],
    phasor: NDArray[np.complex64],
    out: NDArray[np.float32],
) -> None:
    """out (n,) = what `add_waves` makes of the means of the cells (n,)."""
    for row in range(cell.size):
        out[row] = mean[cell[row]] + summed(index[row], coefficient[row], phasor)


@kernel
def verdict_of(p: Any, high: Any, low: Any) -> Any:
    """State and verdict of a probability: 1 over `high`, else 0 under `low`, else 2. Without branches, for nobody could
    foresee them."""
    occupied, free = np.uint8(p > high), np.uint8(p < low)
    return occupied, occupied + np.uint8(2) * ((occupied | free) ^ np.uint8(1))


@kernel
def write_verdicts(
    at: NDArray[np.int32],
    value: NDArray[np.float32],
    over: float,
    under: float,
    probability: NDArray[np.float32],
    state: NDArray[np.uint8],
    verdict: NDArray[np.uint8],
) -> None:
    """Write the probabilities `value` (n,), clipped to [0, 1], and what is said from them to places `at` (n,).

    What is NaN is left out.
    """
    high, low = np.float32(over), np.float32(under)
    for i in range(at.size):
        if value[i] == value[i]:
            p = min(max(value[i], np.float32(0)), np.float32(1))
            probability[at[i]] = p
            state[at[i]], verdict[at[i]] = verdict_of(p, high, low)


@kernel
def put_known(at: NDArray[np.int32], value: NDArray[np.float32], out: NDArray[np.float32]) -> None:
    """out[at] = the probabilities `value` (n,), clipped to [0, 1]; what is NaN is left out."""
    for i in range(at.size):
        if value[i] == value[i]:
            out[at[i]] = min(max(value[i], np.float32(0)), np.float32(1))


@kernel
def write_states(
    over: float, under: float, probability: NDArray[np.float32], state: NDArray[np.uint8], verdict: NDArray[np.uint8]
) -> None:
    """Write what is said from probabilities, (n,) each."""
    high, low = np.float32(over), np.float32(under)
    for i in range(probability.size):
        state[i], verdict[i] = verdict_of(probability[i], high, low)


@kernel
def row_of(cell: NDArray[np.int32], wanted: int, row: int) -> int:
    """The first row whose cell is not below `wanted`; looked for from `row` on, from the start if that is past it."""
    if row > 0 and cell[row - 1] >= wanted:
        row = 0
    # Most often it is one of the next few, which cost less one by one.
    for _ in range(NEAR):
        if row >= cell.size or cell[row] >= wanted:
            return row
        row += 1
    step = 1
    while row + step < cell.size and cell[row + step] < wanted:
        row += step
        step *= 2
    while step > 0:
        if row + step <= cell.size and cell[row + step - 1] < wanted:
            row += step
        step //= 2
    return row


@kernel
def add_waves_of(
    wanted: NDArray[np.int64],
    cell: NDArray[np.int32],
    index: Index,
    coefficient: NDArray[np.complex64],
    phasor: NDArray[np.complex64],
    out: NDArray[np.float32],
) -> None:
    """out (n,) += what `add_waves` adds to the cells `wanted` (n,); fast where these are ascending."""
    row = 0
    for i in range(wanted.size):
        row = row_of(cell, wanted[i], row)
        if row < cell.size and cell[row] == wanted[i]:
            out[i] += summed(index[row], coefficient[row], phasor)


@kernel
def unlikely(
    wanted: NDArray[np.uint32],
    state: NDArray[np.uint8],
    mean: NDArray[np.float32],
    cell: NDArray[np.int32],
    index: Index,
    coefficient: NDArray[np.complex64],
    phasor: NDArray[np.complex64],
    bounds: tuple[float, float],
    rows: NDArray[np.int64],
    value: NDArray[np.float32],
) -> int:
    """How many of the cells `wanted` (n,) are occupied and below bounds[0], or free and above bounds[1].

    rows, value (n,) begin with which of them, and with their mean and waves as of `add_waves_of`.
    """
    row = found = 0
    for i in range(wanted.size):
        at = int(wanted[i])
        row = row_of(cell, at, row)
        here = mean[at]
        if row < cell.size and cell[row] == at:
            here += summed(index[row], coefficient[row], phasor)
        if here < bounds[0] if state[i] else here > bounds[1]:
            rows[found], value[found] = i, here
            found += 1
    return found


@kernel
def add_waves_over_time(
    cell: NDArray[np.int32],
    index: Index,
    coefficient: NDArray[np.complex64],
    phasor: NDArray[np.complex64],
    out: NDArray[np.float32],
) -> None:
    """out[cell, :] += Re Σ coefficient · phasor[index, :]; phasor (n_waves, n_times)."""
    for row in range(cell.size):
        for column in range(index.shape[1]):
            wave, value = index[row, column], coefficient[row, column]
            for time in range(out.shape[1]):
                factor = phasor[wave, time]
                out[cell[row], time] += value.real * factor.real - value.imag * factor.imag


@kernel
def add_waves_at(
    first: NDArray[np.int64],
    last: NDArray[np.int64],
    column: NDArray[np.int64],
    cell: NDArray[np.int32],
    index: Index,
    coefficient: NDArray[np.complex64],
    phasor: NDArray[np.complex64],
    out: NDArray[np.float32],
) -> None:
    """out[j] += Re Σ coefficient · phasor[index, column[j]] for j in [first, last) of every cell with waves."""
    for row in range(cell.size):
        for j in range(first[cell[row]], last[cell[row]]):
            out[j] += summed(index[row], coefficient[row], phasor[:, column[j]])


@kernel
def unit_phasors(frequency: NDArray[np.float64], time: NDArray[np.float64], out: NDArray[np.complex64]) -> None:
    """out (n, m) = exp(2πi frequency time), the cycles reduced in float64."""
    for i in range(frequency.size):
        for j in range(time.size):
            cycles = frequency[i] * time[j]
            angle = 2 * np.pi * (cycles - np.rint(cycles))
            out[i, j] = np.complex64(complex(np.cos(angle), np.sin(angle)))


@kernel
def complex_product(value: Any, factor: Any) -> Any:
    """The real and the negated imaginary part of value · factor."""
    return (
        value.real * factor.real - value.imag * factor.imag,
        -(value.real * factor.imag + value.imag * factor.real),
    )


@fused_kernel
def threshold_blocks(
    cell: NDArray[np.int32],
    index: Index,
    coefficient: NDArray[np.complex64],
    mean: NDArray[np.float32],
    threshold: float,
    anchor: NDArray[np.complex64],
    offset: NDArray[np.float32],
    words: NDArray[np.uint64],
) -> None:
    """words[cell, block]: bits where mean + Re Σ … exceeds the threshold, for uniform samples.

    A wave at the sample ±x from the middle of a block is anchor · exp(±iωx), so that with
    z = coefficient · anchor the 64 samples are (even ± odd) of 32: even = Σ Re z cos ωx,
    odd = -Σ Im z sin ωx. anchor (n_waves, n_blocks): at the middles of the blocks, with the factor
    2; offset (n_waves, 64): cos ωx of x = ½, 1½, … 31½ samples, then sin ωx.
    """
    n_blocks, order = words.shape[1], index.shape[1]
    padded = -(-order // 4) * 4
    wave = np.zeros((padded, 2 * HALF), np.float32)
    real, imag = np.zeros((padded, n_blocks), np.float32), np.zeros((padded, n_blocks), np.float32)
    even, odd = np.empty(HALF, np.float32), np.empty(HALF, np.float32)
    over = np.empty(2 * HALF, np.uint8)
    packed = over.view(np.uint64)
    limit = np.float32(threshold)
    for row in range(cell.size):
        for column in range(order):
            which, value = index[row, column], coefficient[row, column]
            wave[column] = offset[which]
            for block in range(n_blocks):
                real[column, block], imag[column, block] = complex_product(value, anchor[which, block])
        for block in range(n_blocks):
            even[:] = mean[cell[row]]
            odd[:] = np.float32(0)
            for column in range(0, padded, 4):
                a, b = real[column, block], real[column + 1, block]
                c, d = real[column + 2, block], real[column + 3, block]
                e, f = imag[column, block], imag[column + 1, block]
                g, h = imag[column + 2, block], imag[column + 3, block]
                for x in range(HALF):
                    even[x] += (a * wave[column, x] + b * wave[column + 1, x]) + (
                        c * wave[column + 2, x] + d * wave[column + 3, x]
                    )
                    odd[x] += (e * wave[column, HALF + x] + f * wave[column + 1, HALF + x]) + (
                        g * wave[column + 2, HALF + x] + h * wave[column + 3, HALF + x]
                    )
            for x in range(HALF):
                over[HALF + x] = even[x] + odd[x] > limit
                over[HALF - 1 - x] = even[x] - odd[x] > limit
            word = np.uint64(0)
            for eight in range(8):
                word |= ((packed[eight] * GATHER_BITS) >> np.uint64(56)) << np.uint64(8 * eight)
            words[cell[row], block] = word

"""Kernels on packed bit planes: rows of bytes, bitorder "little", bit 0 of byte 0 first.

A *word* is 64 samples [64 b, 64 b + 64) of the absolute sample axis, b its block: words of
different windows line up, so what is computed per word does not depend on who asks.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tidemap.history.jit import kernel, load_word, lowest

Plane = NDArray[np.uint8]
Words = NDArray[np.uint64]
Scalar = Any

WORD = 64
ALL = np.uint64(0xFFFFFFFFFFFFFFFF)
ONE = np.uint64(1)
LAST = np.uint64(63)


def n_bytes(n_samples: int) -> int:
    """Bytes that hold `n_samples` bits.

    >>> n_bytes(2016), n_bytes(1), n_bytes(0)
    (252, 1, 0)
    """
    return (n_samples + 7) // 8


def blocks(start: int, stop: int) -> tuple[int, int]:
    """The half-open range of blocks that covers samples [start, stop).

    >>> blocks(-1, 65)
    (-1, 2)
    """
    return start // WORD, -(-stop // WORD)


@kernel
def aligned_word(plane: Plane, cell: int, word: int) -> Scalar:
    """Bits [64 word, 64 word + 64) of the row of a cell; zeros outside."""
    first, width = 8 * word, plane.shape[1]
    if first >= 0 and first + 8 <= width:
        return load_word(plane, cell * width + first)
    value = np.uint64(0)
    for byte in range(max(0, -first), min(8, width - first)):
        value |= np.uint64(plane[cell, first + byte]) << np.uint64(8 * byte)
    return value


@kernel
def word_at(plane: Plane, cell: int, bit: int) -> Scalar:
    """Bits [bit, bit + 64) of the row of a cell for any, also negative, `bit`; zeros outside."""
    word = bit >> 6
    shift = np.uint64(bit & 63)
    low = aligned_word(plane, cell, word) >> shift
    if shift == np.uint64(0):
        return low
    return low | (aligned_word(plane, cell, word + 1) << (np.uint64(64) - shift))


@kernel
def bit_at(plane: Plane, cell: int, bit: int) -> Scalar:
    return (plane[cell, bit >> 3] >> np.uint8(bit & 7)) & np.uint8(1)


@kernel
def ones(word: Scalar) -> int:
    """The number of set bits (compiles to one instruction)."""
    word = word - ((word >> ONE) & np.uint64(0x5555555555555555))
    word = (word & np.uint64(0x3333333333333333)) + ((word >> np.uint64(2)) & np.uint64(0x3333333333333333))
    word = (word + (word >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    return np.int64((word * np.uint64(0x0101010101010101)) >> np.uint64(56))  # type: ignore[return-value]


@kernel
def count_ones(plane: Plane, out: NDArray[np.int64]) -> None:
    for cell in range(plane.shape[0]):
        total = 0
        for word in range((plane.shape[1] + 7) >> 3):
            total += ones(aligned_word(plane, cell, word))
        out[cell] = total


@kernel
def any_ones(plane: Plane, out: NDArray[np.bool_]) -> None:
    for cell in range(plane.shape[0]):
        found = False
        for word in range((plane.shape[1] + 7) >> 3):
            if aligned_word(plane, cell, word) != np.uint64(0):
                found = True
                break
        out[cell] = found


def copy_window(plane: Plane, first: int, n_samples: int, out: Plane) -> None:
    """out (n_cells, n_bytes(n_samples)), zeros before: bits [first, first + n_samples); zeros outside."""
    if first < 0:
        _copy_words(plane, first, n_samples, out)
        return
    source = plane[:, first >> 3 : (first >> 3) + out.shape[1] + 1]
    width, shift = min(source.shape[1], out.shape[1]), first & 7
    np.right_shift(source[:, :width], shift, out=out[:, :width])
    if shift and width:
        out[:, : source.shape[1] - 1] |= source[:, 1:] << (8 - shift)
    if n_samples & 7:
        out[:, -1] &= (1 << (n_samples & 7)) - 1


@kernel
def _copy_words(plane: Plane, first: int, n_samples: int, out: Plane) -> None:
    for cell in range(plane.shape[0]):
        for word in range((n_samples + 63) >> 6):
            value = word_at(plane, cell, first + 64 * word)
            left = n_samples - 64 * word
            if left < 64:
                value &= (ONE << np.uint64(left)) - ONE
            for byte in range(8 * word, min(8 * word + 8, out.shape[1])):
                out[cell, byte] = np.uint8(value >> np.uint64(8 * (byte & 7)))


@kernel
def last_seen(
    observed: Plane,
    occupied: Plane,
    start: int,
    last: int,
    state: NDArray[np.uint8],
    sample: NDArray[np.int64],
) -> None:
    """Per cell the highest observed bit <= last as `start` + bit, and its state; untouched where none."""
    for cell in range(observed.shape[0]):
        word, row = last >> 6, cell * observed.shape[1]
        value = aligned_word(observed, cell, word) & (ALL >> np.uint64(63 - (last & 63)))
        while value == np.uint64(0) and word > 0:
            word -= 1
            value = load_word(observed, row + 8 * word)
        if value != np.uint64(0):
            position = 64 * word + highest(value)
            sample[cell] = start + position
            state[cell] = bit_at(occupied, cell, position)


@kernel
def highest(word: Scalar) -> int:
    """The position of the highest set bit of a word that is not zero."""
    position = 0
    for step in (32, 16, 8, 4, 2, 1):
        if word >> np.uint64(step) != np.uint64(0):
            word >>= np.uint64(step)
            position += step
    return position


@kernel
def hold(observed: Plane, occupied: Plane, ended: Plane, n_samples: int, hold_samples: int) -> None:
    """In place: every state stands until the next observed sample, at most `hold_samples` after it.

    A sample of `ended` (without cells: none) ends that: what was observed in it stands there, and nothing after it.
    """
    ends = ended.size > 0
    for cell in range(observed.shape[0]):
        left = 0
        state = np.uint8(0)
        for bit in range(n_samples):
            mask = np.uint8(1) << np.uint8(bit & 7)
            over = ends and ended[cell, bit >> 3] & mask
            if observed[cell, bit >> 3] & mask:
                left = hold_samples
                state = bit_at(occupied, cell, bit)
            elif left > 0 and not over:
                left -= 1
                observed[cell, bit >> 3] |= mask
                if state:
                    occupied[cell, bit >> 3] |= mask
            if over:
                left = 0


@kernel
def put(
    observed: Plane,
    occupied: Plane,
    cell: NDArray[np.int64],
    bit: NDArray[np.int64],
    state: NDArray[np.uint8],
) -> None:
    """Set measurements in their given order: of several at one place the last stands."""
    for i in range(bit.size):
        row, byte = cell[i], bit[i] >> 3
        mask = np.uint8(1) << np.uint8(bit[i] & 7)
        observed[row, byte] |= mask
        if state[i]:
            occupied[row, byte] |= mask
        else:
            occupied[row, byte] &= ~mask


@kernel
def put_runs(plane: Plane, first: int, offset: Any, start: Any, stop: Any, chosen: Any) -> None:
    """Set bits [start - first, stop - first) of the chosen runs of every cell."""
    for cell in range(plane.shape[0]):
        for run in range(offset[cell], offset[cell + 1]):
            if chosen[run]:
                for bit in range(start[run] - first, stop[run] - first):
                    plane[cell, bit >> 3] |= np.uint8(1) << np.uint8(bit & 7)


@kernel
def boundaries(observed: Plane, occupied: Plane, n_samples: int, out: Words) -> None:
    """out (n_cells, n_words): bits where a run of constant state begins; bit 0 always."""
    for cell in range(observed.shape[0]):
        for word in range(out.shape[1]):
            observed_word, occupied_word = word_at(observed, cell, 64 * word), word_at(occupied, cell, 64 * word)
            before = word_at(observed, cell, 64 * word - 1)
            value = (observed_word ^ before) | (occupied_word ^ word_at(occupied, cell, 64 * word - 1))
            if word == 0:
                value |= ONE
            if n_samples - 64 * word < 64:
                value &= (ONE << np.uint64(n_samples - 64 * word)) - ONE
            out[cell, word] = value


@kernel
def count_runs(words: Words, out: NDArray[np.int64]) -> None:
    """out (n_cells,): runs of set bits per row."""
    for cell in range(words.shape[0]):
        total = 0
        carry = np.uint64(0)
        for word in range(words.shape[1]):
            value = words[cell, word]
            total += ones(value & ~((value << ONE) | carry))
            carry = value >> LAST
        out[cell] = total


@kernel
def runs(words: Words, first: int, start: NDArray[np.int64], stop: NDArray[np.int64]) -> None:
    """start, stop (count,): `first` + the limits of every run of set bits, row by row, ascending."""
    n_start = n_stop = 0
    for cell in range(words.shape[0]):
        carry = np.uint64(0)
        for word in range(words.shape[1]):
            value = words[cell, word]
            before = (value << ONE) | carry
            begin, end = value & ~before, before & ~value
            carry = value >> LAST
            while begin != np.uint64(0):
                start[n_start] = first + 64 * word + np.int64(lowest(begin))
                n_start += 1
                begin &= begin - ONE
            while end != np.uint64(0):
                stop[n_stop] = first + 64 * word + np.int64(lowest(end))
                n_stop += 1
                end &= end - ONE
        if carry != np.uint64(0):
            stop[n_stop] = first + 64 * words.shape[1]
            n_stop += 1


@kernel
def count_words(words: Words, out: NDArray[np.int64]) -> None:
    """out (n_cells,): set bits per row."""
    for cell in range(words.shape[0]):
        total = 0
        for word in range(words.shape[1]):
            total += ones(words[cell, word])
        out[cell] = total


@kernel
def positions(words: Words, first: int, out: NDArray[np.int64]) -> None:
    """out (count,): `first` + the position of every set bit, row by row, ascending."""
    found = 0
    for cell in range(words.shape[0]):
        for word in range(words.shape[1]):
            value = words[cell, word]
            while value != np.uint64(0):
                out[found] = first + 64 * word + np.int64(lowest(value))
                found += 1
                value &= value - ONE


@kernel
def mismatch(predicted: Words, observed: Plane, occupied: Plane, first: int) -> None:
    """In place: predicted becomes (predicted xor occupied) and observed; `first` = bit of word 0."""
    for cell in range(predicted.shape[0]):
        for word in range(predicted.shape[1]):
            bit = first + 64 * word
            wrong = predicted[cell, word] ^ word_at(occupied, cell, bit)
            predicted[cell, word] = wrong & word_at(observed, cell, bit)


@kernel
def flip_runs(words: Words, first: int, offset: Any, start: Any, stop: Any) -> None:
    """In place: invert the samples of every run, those outside the words left out."""
    end = first + 64 * words.shape[1]
    for cell in range(words.shape[0]):
        for run in range(offset[cell], offset[cell + 1]):
            for sample in range(max(start[run], first), min(stop[run], end)):
                bit = sample - first
                words[cell, bit >> 6] ^= ONE << np.uint64(bit & 63)

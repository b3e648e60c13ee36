"""What repeats in bit planes: equal rows, equal samples, and states that stand. Rows of bytes, bitorder "little"."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tidemap.history.bits import Plane
from tidemap.history.jit import kernel


def distinct(plane: Plane) -> tuple[Plane, NDArray[np.int64]]:
    """The distinct rows in the order of their first appearance, and which of them each row is.

    >>> rows, which = distinct(np.array([[7, 1], [0, 2], [7, 1]], np.uint8))
    >>> rows.tolist(), which.tolist()
    ([[7, 1], [0, 2]], [0, 1, 0])
    """
    width = plane.shape[1]
    numbers: dict[bytes, int] = {}
    rows = np.ascontiguousarray(plane).view(f"V{width}").ravel().tolist() if plane.size else [b""] * len(plane)
    which = np.array([numbers.setdefault(row, len(numbers)) for row in rows], np.int64)
    return np.frombuffer(b"".join(numbers), np.uint8).reshape(len(numbers), width), which


def transpose(plane: Plane) -> Plane:
    """(n, m) bytes to (8 m, ceil(n / 8)): bit b of row a becomes bit a of row b.

    >>> transpose(np.array([[0b101], [0b100]], np.uint8)).ravel().tolist()
    [1, 0, 3, 0, 0, 0, 0, 0]
    """
    out = np.zeros((8 * plane.shape[1], -(-len(plane) // 8)), np.uint8)
    _transpose(plane, out)
    return out


def fill_unobserved(observed: Plane, occupied: Plane) -> Plane:
    """occupied, with the samples that were not observed in the state before them; the first ones in that after them.

    What was never observed is free.
    """
    out = np.empty(observed.shape, np.uint8)
    _fill_unobserved(observed, occupied, out)
    return out


@kernel
def _transpose(plane: Plane, out: Plane) -> None:
    for block in range(out.shape[1]):
        rows = min(8, plane.shape[0] - 8 * block)
        for byte in range(plane.shape[1]):
            word = np.uint64(0)
            for row in range(rows):
                word |= np.uint64(plane[8 * block + row, byte]) << np.uint64(8 * row)
            word = _transpose_word(word)
            for bit in range(8):
                out[8 * byte + bit, block] = (word >> np.uint64(8 * bit)) & np.uint64(255)


@kernel
def _transpose_word(word: Any) -> Any:
    """Eight rows of eight bits with their columns as rows: squares of one, two, then four bits change places."""
    change = (word ^ (word >> np.uint64(7))) & np.uint64(0x00AA00AA00AA00AA)
    word ^= change ^ (change << np.uint64(7))
    change = (word ^ (word >> np.uint64(14))) & np.uint64(0x0000CCCC0000CCCC)
    word ^= change ^ (change << np.uint64(14))
    change = (word ^ (word >> np.uint64(28))) & np.uint64(0x00000000F0F0F0F0)
    return word ^ change ^ (change << np.uint64(28))


@kernel
def _fill_unobserved(observed: Plane, occupied: Plane, out: Plane) -> None:
    for cell in range(observed.shape[0]):
        state = _first_state(observed, occupied, cell)
        for byte in range(observed.shape[1]):
            known, value = np.int64(observed[cell, byte]), np.int64(occupied[cell, byte])
            for shift in (1, 2, 4):
                value |= (value << shift) & ~known & 255
                known |= (known << shift) & 255
            if state:
                value |= ~known & 255
            out[cell, byte] = value
            state = value >> 7


@kernel
def _first_state(observed: Plane, occupied: Plane, cell: int) -> Any:
    for byte in range(observed.shape[1]):
        known = np.int64(observed[cell, byte])
        if known:
            return np.int64(occupied[cell, byte]) & known & -known
    return np.int64(0)

"""Products: many rows times one matrix, so that a row's result depends on nothing but the row.

A matrix library picks its kernel, and with it the order of its sums, by the number of rows and by where a row
stands among them. Here every sum has one order: over the inner axis from its first element to its last.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tidemap.history.jit import fused_kernel

TILE: Final = 4
"""Rows, and steps of the inner axis, that are worked on at once."""
WIDTH: Final = 64
"""Columns of a panel."""

Matrix = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Panels:
    """A matrix (n_inner, n_columns) cut into panels of WIDTH columns: packed (n_panels, n_inner · WIDTH) float32.

    The inner axis is filled up to a multiple of TILE with zeros, the columns to one of WIDTH.
    """

    packed: Matrix
    n_columns: int


def pack(matrix: Matrix) -> Panels:
    """The panels of a matrix (n_inner, n_columns)."""
    n_inner, n_columns = matrix.shape
    packed = np.zeros((-(-n_columns // WIDTH), n_inner + -n_inner % TILE, WIDTH), np.float32)
    for number, panel in enumerate(packed):
        part = matrix[:, number * WIDTH : (number + 1) * WIDTH]
        panel[:n_inner, : part.shape[1]] = part
    return Panels(packed.reshape(packed.shape[0], -1), n_columns)


def product(rows: Matrix, panels: Panels) -> Matrix:
    """rows (n, n_inner) times the matrix, (n, n_columns) float32, on one thread."""
    n_inner = panels.packed.shape[1] // WIDTH
    full = np.zeros((rows.shape[0] + -rows.shape[0] % TILE, n_inner), rows.dtype)  # ten times as fast as np.pad
    full[: rows.shape[0], : rows.shape[1]] = rows
    out = np.empty((rows.shape[0], panels.n_columns), np.float32)
    _multiply(full, panels.packed, out)
    return out


@fused_kernel
def _multiply(rows: Matrix, panels: Matrix, out: Matrix) -> None:
    """out = rows times panels: TILE rows by WIDTH columns at a time, which stay in the nearest cache."""
    total = np.empty(TILE * WIDTH, np.float32)
    for number in range(panels.shape[0]):
        panel = panels[number]
        for row in range(0, rows.shape[0], TILE):
            first, second, third, fourth = rows[row], rows[row + 1], rows[row + 2], rows[row + 3]
            total[:] = np.float32(0)
            for inner in range(0, rows.shape[1], TILE):
                a0, a1, a2, a3 = first[inner], first[inner + 1], first[inner + 2], first[inner + 3]
                b0, b1, b2, b3 = second[inner], second[inner + 1], second[inner + 2], second[inner + 3]
                c0, c1, c2, c3 = third[inner], third[inner + 1], third[inner + 2], third[inner + 3]
                d0, d1, d2, d3 = fourth[inner], fourth[inner + 1], fourth[inner + 2], fourth[inner + 3]
                part = panel[inner * WIDTH : (inner + TILE) * WIDTH]
                for x in range(WIDTH):
                    w0, w1, w2, w3 = part[x], part[WIDTH + x], part[2 * WIDTH + x], part[3 * WIDTH + x]
                    total[x] = (((total[x] + a0 * w0) + a1 * w1) + a2 * w2) + a3 * w3
                    total[WIDTH + x] = (((total[WIDTH + x] + b0 * w0) + b1 * w1) + b2 * w2) + b3 * w3
                    total[2 * WIDTH + x] = (((total[2 * WIDTH + x] + c0 * w0) + c1 * w1) + c2 * w2) + c3 * w3
                    total[3 * WIDTH + x] = (((total[3 * WIDTH + x] + d0 * w0) + d1 * w1) + d2 * w2) + d3 * w3
            columns = min(WIDTH, out.shape[1] - number * WIDTH)
            for which in range(min(TILE, out.shape[0] - row)):
                for x in range(columns):
                    out[row + which, number * WIDTH + x] = total[which * WIDTH + x]

"""Centroids: where in a group of occupied cells their common surface is, finer than a cell."""

from itertools import product

import numpy as np
from numpy.typing import NDArray

from tidemap.space.grid import GridGeometry


def surface_centroids(grid: GridGeometry, cell: NDArray[np.int64], weight: NDArray[np.floating]) -> NDArray[np.float64]:
    """For each of some cells (n,), ascending, the weighted mean (n, 3) of it and those that touch it, in metres.

    A surface between two layers of cells is seen in both: taken for two surfaces, scans would fit either. O(n log n).

    >>> grid = GridGeometry("map", (0.0, 0.0, 0.0), 1.0, (4, 1, 1))
    >>> surface_centroids(grid, np.array([0, 1, 3]), np.array([1.0, 3.0, 1.0]))[:, 0].tolist()
    [1.25, 1.25, 3.5]
    """
    index, (_, ny, nz) = grid.index(cell), grid.shape3
    total, moment = np.zeros(len(cell)), np.zeros((len(cell), 3))
    for step in product((-1, 0, 1), repeat=3):
        other = index + step
        wanted = cell + (step[0] * ny + step[1]) * nz + step[2]
        row = np.minimum(np.searchsorted(cell, wanted), len(cell) - 1)
        touches = (cell[row] == wanted) & ((other >= 0) & (other < grid.shape3)).all(axis=1)
        shared = np.where(touches, weight[row], 0.0)
        total += shared
        moment += shared[:, np.newaxis] * step
    return grid.centre_at(index) + grid.resolution_m * moment / np.maximum(total, np.finfo(float).tiny)[:, np.newaxis]

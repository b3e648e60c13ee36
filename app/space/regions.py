"""Regions: connected groups of marked cells, over space and over consecutive samples."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from app.space.grid import NEIGHBOURS, Grid


def label_regions(
    grid: Grid, sample: NDArray[np.int64], cell: NDArray[np.int64], state: NDArray[np.uint8]
) -> NDArray[np.int64]:
    """Label (n,) of each marked (sample, cell); the marks are distinct.

    Two marks belong together when they have the same state and are the same cell in consecutive samples, or
    neighbours (26) in the same sample. O(n log n).
    """
    n = len(cell)
    if n == 0:
        return np.empty(0, np.int64)
    index = grid.index(cell)
    low = sample.min()
    key = _key(grid, sample - low, index, state)
    order = np.argsort(key)
    pairs = [_pairs(key, order, _key(grid, sample - low + 1, index, state), np.ones(n, np.bool_))]
    for step in NEIGHBOURS:
        moved = index + step
        inside = np.asarray(((moved >= 0) & (moved < grid.shape3)).all(axis=1), np.bool_)
        if inside.any():
            pairs.append(_pairs(key, order, _key(grid, sample - low, moved, state), inside))
    rows, columns = np.concatenate(pairs, axis=1)
    graph = coo_array((np.ones(len(rows), np.uint8), (rows, columns)), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)


def _key(
    grid: Grid, sample: NDArray[np.int64], index: NDArray[np.int64], state: NDArray[np.uint8]
) -> NDArray[np.int64]:
    nx, ny, nz = grid.shape3
    linear = (index[:, 0] * ny + index[:, 1]) * nz + index[:, 2]
    return np.asarray((sample * (nx * ny * nz) + linear) * 2 + state, np.int64)


def _pairs(
    key: NDArray[np.int64], order: NDArray[np.intp], wanted: NDArray[np.int64], valid: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """(2, m): marks and the marks that have the wanted key."""
    position = np.minimum(np.searchsorted(key, wanted, sorter=order), len(key) - 1)
    found = valid & (key[order[position]] == wanted)
    return np.stack([np.flatnonzero(found), order[position[found]]])

"""Regions: connected groups of marked cells, over space and over consecutive samples."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tidemap.space.grid import NEIGHBOURS, GridGeometry

STEPS = np.array(NEIGHBOURS, np.int64)


def label_regions(
    grid: GridGeometry, sample: NDArray[np.int64], cell: NDArray[np.int64], state: NDArray[np.uint8]
) -> NDArray[np.int64]:
    """Label (n,) of each marked (sample, cell); the marks are distinct.

    Two marks belong together when they have the same state and are the same cell in consecutive samples, or
    neighbours (26) in the same sample. O(n log n).
    """
    if not len(cell):
        return np.empty(0, np.int64)
    key = ((sample - sample.min()) * grid.n_cells + cell) * 2 + state
    order = np.argsort(key)
    parent, label = np.arange(len(key)), np.empty(len(key), np.int64)
    _join(key[order], grid.shape3, STEPS, parent)
    label[order] = _numbered(parent)
    return label


@njit(cache=True, nogil=True)
def _join(
    key: NDArray[np.int64], shape: tuple[int, int, int], steps: NDArray[np.int64], parent: NDArray[np.int64]
) -> None:
    """In place: `parent` of every mark (keys ascending) becomes the first of its region."""
    plane, row = shape[1] * shape[2], shape[2]
    n_cells = shape[0] * plane
    for i in range(key.size):
        _meet(key, parent, i, key[i] + 2 * n_cells)
        cell = (key[i] >> 1) % n_cells
        at_x, at_y, at_z = cell // plane, cell // row % shape[1], cell % row
        for step in steps:
            x, y, z = at_x + step[0], at_y + step[1], at_z + step[2]
            if 0 <= x < shape[0] and 0 <= y < shape[1] and 0 <= z < shape[2]:
                _meet(key, parent, i, key[i] + 2 * (step[0] * plane + step[1] * row + step[2]))
    for i in range(key.size):
        parent[i] = _root(parent, i)


@njit(cache=True, nogil=True)
def _numbered(parent: NDArray[np.int64]) -> NDArray[np.int64]:
    """Labels 0, 1 and so on of regions that are given by their first marks, in the order of these."""
    label = np.empty_like(parent)
    count = 0
    for i in range(parent.size):
        if parent[i] == i:
            label[i] = count
            count += 1
        else:
            label[i] = label[parent[i]]
    return label


@njit(cache=True, nogil=True)
def _meet(key: NDArray[np.int64], parent: NDArray[np.int64], mark: int, wanted: int) -> None:
    """Unite the regions of a mark and of the later mark with this key, if there is one."""
    other, above = mark + 1, key.size
    while other < above:
        middle = (other + above) // 2
        if key[middle] < wanted:
            other = middle + 1
        else:
            above = middle
    if other < key.size and key[other] == wanted:
        one, two = _root(parent, mark), _root(parent, other)
        parent[max(one, two)] = min(one, two)


@njit(cache=True, nogil=True)
def _root(parent: NDArray[np.int64], mark: int) -> int:
    """The first mark of a region, as far as it is known; halves the way there."""
    while parent[mark] != mark:
        parent[mark] = parent[parent[mark]]
        mark = parent[mark]
    return mark

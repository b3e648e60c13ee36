"""Ranges: how far rays travel before they meet an occupied cell; what an exact sensor would measure."""

from math import inf

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tidemap.history.jit import kernel
from tidemap.space.grid import GridGeometry
from tidemap.space.walk import SKIP, Array, Integers, Walk, aim, clip, in_cells, is_inside, set_faces, set_gaps


def first_ranges(
    grid: GridGeometry, occupied: NDArray[np.bool_], origin: ArrayLike, ways: ArrayLike, max_range_m: float
) -> Array:
    """Metres (n,) from `origin` (3,) along unit `ways` (n, 3) to the first occupied cell; infinite where none is met.

    occupied: of the grid's shape with three axes. What is further than `max_range_m` is not met. O(cells passed).

    >>> grid = GridGeometry("map", (0.0, 0.0, 0.0), 0.5, (4, 1, 2))
    >>> wall = np.zeros((4, 1, 2), bool)
    >>> wall[3] = True
    >>> first_ranges(grid, wall, [0.25, 0.25, 0.25], [[1, 0, 0], [-1, 0, 0]], 9.0).tolist()
    [1.25, inf]
    """
    start = np.asarray(origin, np.float64)
    ends = start + max_range_m * np.asarray(ways, np.float64)
    share = np.empty(len(ends))
    cells = np.ascontiguousarray(occupied, np.bool_).reshape(-1)
    _first(np.array(grid.shape3), cells, in_cells(grid, start[np.newaxis])[0], in_cells(grid, ends), share)
    return share * max_range_m


@kernel
def _first(shape: Integers, occupied: NDArray[np.bool_], start: Array, ends: Array, share: Array) -> None:
    """Set the share (n,) of each ray that is free."""
    walk = Walk(np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3, np.int64), np.empty(3, np.int64))
    for ray in range(len(ends)):
        share[ray] = inf
        if aim(start, ends[ray], inf, walk) == SKIP:
            continue
        full = set_gaps(walk)
        enter, leave = clip(shape, start, walk, full)
        if enter < leave:
            at = set_faces(shape, start, walk, enter / full, leave / full, is_inside(shape, walk.stop))
            share[ray] = _walk(walk, at, enter, occupied) / full


@kernel
def _walk(walk: Walk, at: int, now: float, occupied: NDArray[np.bool_]) -> float:
    """When the first occupied cell is entered, from linear cell `at` on; infinite where none is."""
    for _ in range(walk.left.sum()):
        if occupied[at]:
            return now
        axis = np.argmin(walk.ahead)
        now = walk.ahead[axis]
        at += walk.stride[axis]
        walk.left[axis] -= 1
        walk.ahead[axis] = now + walk.gap[axis] if walk.left[axis] > 0 else inf
    return now if occupied[at] else inf

"""Walks: a ray on its way through the cells of a grid, face by face (Amanatides and Woo, Eurographics 1987)."""

from math import inf
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tidemap.history.jit import kernel
from tidemap.space.grid import GridGeometry
from tidemap.space.ranges import LONGER

Array: TypeAlias = NDArray[np.float64]
Integers: TypeAlias = NDArray[np.int64]

MAX_AWAY = 1e15
"""How many cells an end may be away unless its ray is cut off; further off numbers are coarser than a cell."""
MIN_SHARE = 2.0**-40
"""A ray is parallel to an axis if it moves along it by less than this share of its longest part."""
SKIP, WHOLE, CUT = 0, 1, 2
"""What becomes of a ray."""


class Walk(NamedTuple):
    """A ray on its way, by axis, (3,) each; lengths in cells, `set_gaps` says what times are.

    way: from the start to the stop; gap: time between two faces; ahead: when the next face is crossed, infinite
    where none is left; left: how many are; stride: what crossing one adds to the linear cell.
    """

    way: Array
    stop: Array
    gap: Array
    ahead: Array
    left: Integers
    stride: Integers


def in_cells(grid: GridGeometry, points: ArrayLike) -> Array:
    """Points (n, 3) in lengths of a cell from the grid's lower corner; in the middle of its layer if it is flat."""
    with np.errstate(over="ignore"):  # what is that far becomes infinite, and is skipped
        found = (np.asarray(points, np.float64) - np.array(grid.origin)) / grid.resolution_m
    if grid.shape3[2] == 1:
        found[:, 2] = 0.5
    return np.asarray(found)


@kernel
def aim(start: Array, end: Array, max_range: float, walk: Walk) -> int:
    """Set the ray's way and stop. Returns SKIP, WHOLE or CUT."""
    squared = 0.0
    for axis in range(3):
        walk.way[axis], walk.stop[axis] = end[axis] - start[axis], end[axis]
        squared += walk.way[axis] ** 2
    whole = squared <= (max_range * LONGER) ** 2
    if not squared < (MAX_AWAY**2 if whole else inf):  # NaN is not either
        return SKIP
    if whole:
        return WHOLE
    share = max_range / np.sqrt(squared)
    for axis in range(3):
        walk.way[axis] *= share
        walk.stop[axis] = start[axis] + walk.way[axis]
    return CUT


@kernel
def is_inside(shape: Integers, point: Array) -> bool:
    inside = True
    for axis in range(3):
        inside &= bool(0 <= point[axis] < shape[axis])
    return inside


@kernel
def linear_cell(shape: Integers, point: Array) -> int:
    """The linear cell with a point of the grid."""
    return int((int(point[0]) * shape[1] + int(point[1])) * shape[2] + int(point[2]))


@kernel
def set_gaps(walk: Walk) -> float:
    """Set the time from one face to the next along each axis; returns that of the whole ray.

    The unit of time is chosen so that a cell's length along an axis takes the product of the lengths of the ray
    along the others. So nothing is divided, and faces that are crossed together have equal times wherever
    products of the coordinates are exact.
    """
    longest = max(abs(walk.way[0]), abs(walk.way[1]), abs(walk.way[2]))
    full = 1.0
    walk.gap[:] = 1.0
    for axis in range(3):
        if abs(walk.way[axis]) <= MIN_SHARE * longest:
            walk.way[axis] = 0.0
            continue
        full *= abs(walk.way[axis])
        for other in range(3):
            if other != axis:
                walk.gap[other] *= abs(walk.way[axis])
    return full


@kernel
def clip(shape: Integers, start: Array, walk: Walk, full: float) -> tuple[float, float]:
    """When the ray enters and leaves the grid; it stays out unless it enters before it leaves."""
    enter, leave = 0.0, full
    for axis in range(3):
        if walk.way[axis] > 0:
            enter = max(enter, -start[axis] * walk.gap[axis])
            leave = min(leave, (shape[axis] - start[axis]) * walk.gap[axis])
        elif walk.way[axis] < 0:
            enter = max(enter, (start[axis] - shape[axis]) * walk.gap[axis])
            leave = min(leave, start[axis] * walk.gap[axis])
        elif not 0 <= start[axis] < shape[axis]:
            leave = enter
    return enter, leave


@kernel
def set_faces(shape: Integers, start: Array, walk: Walk, enter: float, leave: float, inside: bool) -> int:
    """Set the faces ahead and the steps left on each axis; returns the first linear cell.

    enter, leave: shares of the way, 0 to 1. Both ends are kept in the grid, and so is every step between them.
    """
    at, stride = 0, shape[0] * shape[1] * shape[2]
    for axis in range(3):
        stride //= shape[axis]
        forward = walk.way[axis] > 0
        last_at = walk.stop[axis] if inside else start[axis] + leave * walk.way[axis]
        first = cell_on(start[axis] + enter * walk.way[axis], shape[axis])
        steps = cell_on(last_at, shape[axis]) - first
        face = first + 1 - start[axis] if forward else start[axis] - first
        walk.left[axis] = 0 if walk.way[axis] == 0 else max(0, steps if forward else -steps)
        walk.ahead[axis] = face * walk.gap[axis] if walk.left[axis] else inf
        walk.stride[axis] = stride if forward else -stride
        at += first * stride
    return at


@kernel
def cell_on(coordinate: float, n: int) -> int:
    """The cell of an axis that a coordinate is in, or the nearest."""
    return min(max(int(np.floor(coordinate)), 0), n - 1)

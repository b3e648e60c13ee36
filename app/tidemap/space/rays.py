"""Rays: which cells a scan saw occupied, and which it saw free (Amanatides and Woo, Eurographics 1987)."""

from dataclasses import dataclass
from math import inf
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tidemap.history.jit import kernel
from tidemap.space.grid import GridGeometry

Array: TypeAlias = NDArray[np.float64]
Integers: TypeAlias = NDArray[np.int64]

MAX_MIN_HITS = 100
"""The most hits that a noise filter can ask for; the hits of a cell are counted in seven bits."""
MAX_AWAY = 1e15
"""How many cells an end may be away; further off numbers are coarser than a cell."""
MIN_SHARE = 2.0**-40
"""A ray is parallel to an axis if it moves along it by less than this share of its longest part."""
PASSED, HIT, FULL = 1, 2, 254
"""In the tally of a cell: the bit that a ray passed, what one hit adds, and from where on none is added."""
SKIP, WHOLE, CUT = 0, 1, 2
"""What becomes of a ray."""


class Walk(NamedTuple):
    """A ray on its way, by axis, (3,) each; lengths in cells, `_set_gaps` says what times are.

    way: from the start to the stop; gap: time between two faces; ahead: when the next face is crossed, infinite
    where none is left; left: how many are; stride: what crossing one adds to the linear cell.
    """

    way: Array
    stop: Array
    gap: Array
    ahead: Array
    left: Integers
    stride: Integers


@dataclass(frozen=True, slots=True, eq=False)
class SeenCells:
    """cell (n,) uint32, ascending and distinct; state (n,) uint8: 1 occupied, 0 free. All others were not seen."""

    cell: NDArray[np.uint32]
    state: NDArray[np.uint8]


def cast_rays(
    grid: GridGeometry, origin: ArrayLike, points: ArrayLike, *, max_range_m: float = inf, min_hits: int = 1
) -> SeenCells:
    """What rays from `origin` (3,) to the ends `points` (n, 3) see, all in metres in the grid's frame.

    The cell with a ray's end is hit; cells with more than a point of the ray before that are passed. A ray longer
    than `max_range_m` is cut off there, hits nothing and leaves out the cell with its cut. A cell is occupied from
    `min_hits` hits on, else free if a ray passed it, else not seen. Ends that are not finite, or further than
    MAX_AWAY cells, are skipped. A grid of one layer is flat: z is left out, also of ranges. Raises ValueError for an
    origin that is not finite, a range that is not positive, and other min_hits than 1 to MAX_MIN_HITS.
    O(cells passed), and a byte a cell of the grid.
    """
    if not np.isfinite(origin).all():
        raise ValueError("The origin of the rays is NaN or infinite. Send the pose of the sensor, or leave it out.")
    if not max_range_m > 0:
        raise ValueError(f"max_range is {max_range_m}; send a positive length in metres.")
    if not 1 <= min_hits <= MAX_MIN_HITS:
        raise ValueError(f"min_hits is {min_hits}; send 1 to {MAX_MIN_HITS}.")
    shape, start, ends = (
        np.array(grid.shape3),
        _in_cells(grid, np.asarray(origin)[np.newaxis])[0],
        _in_cells(grid, points),
    )
    tally, seen = np.zeros(grid.n_cells, np.uint8), np.empty(grid.n_cells, np.uint32)
    n_seen = _cast(shape, start, ends, max_range_m / grid.resolution_m, tally, seen)
    cell = np.sort(seen[:n_seen])
    count = tally[cell]
    occupied = count >= min_hits * HIT
    known = occupied | ((count & PASSED) > 0)
    return SeenCells(cell[known], occupied[known].astype(np.uint8))


def _in_cells(grid: GridGeometry, points: ArrayLike) -> Array:
    """Points (n, 3) in lengths of a cell from the grid's lower corner; in the middle of its layer if it is flat."""
    with np.errstate(over="ignore"):  # what is that far becomes infinite, and is skipped
        found = (np.asarray(points, np.float64) - np.array(grid.origin)) / grid.resolution_m
    if grid.shape3[2] == 1:
        found[:, 2] = 0.5
    return np.asarray(found)


@kernel
def _cast(
    shape: Integers,
    start: Array,
    ends: Array,
    max_range: float,
    tally: NDArray[np.uint8],
    seen: NDArray[np.uint32],
) -> int:
    """Tally all rays; `seen` gets the cells with a tally. Returns their number. Lengths are in cells."""
    walk = Walk(np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3, np.int64), np.empty(3, np.int64))
    n_seen = 0
    for ray in range(len(ends)):
        cut = _aim(start, ends[ray], max_range, walk)
        if cut == SKIP:
            continue
        inside = _is_inside(shape, walk.stop)
        full = _set_gaps(walk)
        enter, leave = _clip(shape, start, walk, full)
        if enter < leave:
            at = _plan(shape, start, walk, enter / full, leave / full, inside)
            n_seen = _walk(walk, at, enter, leave, int(not inside), tally, seen, n_seen)
        if inside and cut == WHOLE:
            n_seen = _hit(_linear(shape, walk.stop), tally, seen, n_seen)
    return n_seen


@kernel
def _aim(start: Array, end: Array, max_range: float, walk: Walk) -> int:
    """Set the ray's way and stop. Returns SKIP, WHOLE or CUT."""
    squared = 0.0
    for axis in range(3):
        walk.way[axis], walk.stop[axis] = end[axis] - start[axis], end[axis]
        squared += walk.way[axis] ** 2
    if not squared < MAX_AWAY**2:  # NaN is not either
        return SKIP
    if squared <= max_range**2:
        return WHOLE
    share = max_range / np.sqrt(squared)
    for axis in range(3):
        walk.way[axis] *= share
        walk.stop[axis] = start[axis] + walk.way[axis]
    return CUT


@kernel
def _is_inside(shape: Integers, point: Array) -> bool:
    inside = True
    for axis in range(3):
        inside &= bool(0 <= point[axis] < shape[axis])
    return inside


@kernel
def _linear(shape: Integers, point: Array) -> int:
    """The linear cell with a point of the grid."""
    return int((int(point[0]) * shape[1] + int(point[1])) * shape[2] + int(point[2]))


@kernel
def _set_gaps(walk: Walk) -> float:
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
def _clip(shape: Integers, start: Array, walk: Walk, full: float) -> tuple[float, float]:
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
def _plan(shape: Integers, start: Array, walk: Walk, enter: float, leave: float, inside: bool) -> int:
    """Set the faces ahead and the steps left on each axis; returns the first linear cell.

    enter, leave: shares of the way, 0 to 1. Both ends are kept in the grid, and so is every step between them.
    """
    at, stride = 0, shape[0] * shape[1] * shape[2]
    for axis in range(3):
        stride //= shape[axis]
        forward = walk.way[axis] > 0
        last_at = walk.stop[axis] if inside else start[axis] + leave * walk.way[axis]
        first = _cell_on(start[axis] + enter * walk.way[axis], shape[axis])
        steps = _cell_on(last_at, shape[axis]) - first
        face = first + 1 - start[axis] if forward else start[axis] - first
        walk.left[axis] = 0 if walk.way[axis] == 0 else max(0, steps if forward else -steps)
        walk.ahead[axis] = face * walk.gap[axis] if walk.left[axis] else inf
        walk.stride[axis] = stride if forward else -stride
        at += first * stride
    return at


@kernel
def _cell_on(coordinate: float, n: int) -> int:
    """The cell of an axis that a coordinate is in, or the nearest."""
    return min(max(int(np.floor(coordinate)), 0), n - 1)


@kernel
def _walk(
    walk: Walk,
    at: int,
    now: float,
    leave: float,
    beyond: int,
    tally: NDArray[np.uint8],
    seen: NDArray[np.uint32],
    n_seen: int,
) -> int:
    """Mark the cells on the way from linear cell `at` as passed, the last one only if the ray goes `beyond`.

    Written without calls and arrays of three: they would take most of the time.
    """
    x, y, z = walk.ahead[0], walk.ahead[1], walk.ahead[2]
    gap_x, gap_y, gap_z = walk.gap[0], walk.gap[1], walk.gap[2]
    stride_x, stride_y, stride_z = walk.stride[0], walk.stride[1], walk.stride[2]
    left_x, left_y, left_z = walk.left[0], walk.left[1], walk.left[2]
    for _ in range(left_x + left_y + left_z + beyond):
        crossed = min(x, y, z, leave)
        if crossed > now:  # faces that are crossed together have a mere point between them
            now = crossed
            if tally[at] == 0:
                seen[n_seen] = at
                n_seen += 1
            tally[at] |= PASSED
        if x <= y and x <= z:
            at += stride_x
            left_x -= 1
            x = x + gap_x if left_x > 0 else inf
        elif y <= z:
            at += stride_y
            left_y -= 1
            y = y + gap_y if left_y > 0 else inf
        else:
            at += stride_z
            left_z -= 1
            z = z + gap_z if left_z > 0 else inf
    return n_seen


@kernel
def _hit(at: int, tally: NDArray[np.uint8], seen: NDArray[np.uint32], n_seen: int) -> int:
    """Count a hit of the linear cell `at`."""
    if tally[at] == 0:
        seen[n_seen] = at
        n_seen += 1
    if tally[at] < FULL:
        tally[at] += HIT
    return n_seen

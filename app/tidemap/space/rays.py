"""Rays: which cells a scan saw occupied, and which it saw free (Amanatides and Woo, Eurographics 1987)."""

from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tidemap.history.jit import kernel
from tidemap.space.grid import GridGeometry
from tidemap.space.walk import (
    SKIP,
    WHOLE,
    Array,
    Integers,
    Walk,
    aim,
    clip,
    in_cells,
    is_inside,
    linear_cell,
    set_faces,
    set_gaps,
)

MAX_MIN_HITS = 100
"""The most hits that a noise filter can ask for; the hits of a cell are counted in seven bits."""
PASSED, HIT, FULL = 1, 2, 254
"""In the tally of a cell: the bit that a ray passed, what one hit adds, and from where on none is added."""


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
    `min_hits` hits on, else free if a ray passed it, else not seen. Ends that are not finite are skipped, and so are
    those further than MAX_AWAY cells whose ray is not cut off. A grid of one layer is flat: z is left out, also of
    ranges. Raises ValueError for an origin that is not finite, a range that is not positive, and other min_hits than 1
    to MAX_MIN_HITS. O(cells passed), and a byte a cell of the grid.
    """
    if not np.isfinite(origin).all():
        raise ValueError("The origin of the rays is NaN or infinite. Send the pose of the sensor, or leave it out.")
    if not max_range_m > 0:
        raise ValueError(f"max_range is {max_range_m}; send a positive length in metres.")
    if not 1 <= min_hits <= MAX_MIN_HITS:
        raise ValueError(f"min_hits is {min_hits}; send 1 to {MAX_MIN_HITS}.")
    shape, start, ends = (
        np.array(grid.shape3),
        in_cells(grid, np.asarray(origin)[np.newaxis])[0],
        in_cells(grid, points),
    )
    tally, seen = np.zeros(grid.n_cells, np.uint8), np.empty(grid.n_cells, np.uint32)
    n_seen = _cast(shape, start, ends, max_range_m / grid.resolution_m, tally, seen)
    cell = np.sort(seen[:n_seen])
    count = tally[cell]
    occupied = count >= min_hits * HIT
    known = occupied | ((count & PASSED) > 0)
    return SeenCells(cell[known], occupied[known].astype(np.uint8))


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
        cut = aim(start, ends[ray], max_range, walk)
        if cut == SKIP:
            continue
        inside = is_inside(shape, walk.stop)
        full = set_gaps(walk)
        enter, leave = clip(shape, start, walk, full)
        if enter < leave:
            at = set_faces(shape, start, walk, enter / full, leave / full, inside)
            n_seen = _walk(walk, at, enter, leave, int(not inside), tally, seen, n_seen)
        if inside and cut == WHOLE:
            n_seen = _hit(linear_cell(shape, walk.stop), tally, seen, n_seen)
    return n_seen


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

"""Which cell a ray hits first (Amanatides and Woo, 1987), over the cells that are drawn."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Index = tuple[int, int, int]


def rows_by_index(index: NDArray[np.int32]) -> dict[Index, int]:
    """The row of every drawn cell (n, 3), to look cells up while walking along a ray."""
    return {(i, j, k): row for row, (i, j, k) in enumerate(index.tolist())}


def first_hit(
    origin: NDArray[np.float64], direction: NDArray[np.float64], drawn: Mapping[Index, int], shape: Index
) -> Index | None:
    """The first drawn cell along a ray, or None.

    `origin` and `direction` (3,) are in grid steps (cell [i,j,k] fills [i, i+1) and so on); `shape` bounds the walk.

    >>> drawn = {(2, 0, 0): 0}
    >>> first_hit(np.array([-1.0, 0.5, 0.5]), np.array([1.0, 0.0, 0.0]), drawn, (4, 4, 1))
    (2, 0, 0)
    """
    entry = _enter(origin, direction, np.asarray(shape, dtype=np.float64))
    if entry is None:
        return None
    start = origin + direction * entry
    cell = np.clip(np.floor(start), 0, np.asarray(shape) - 1).astype(int)
    step = np.sign(direction).astype(int)
    with np.errstate(divide="ignore", invalid="ignore"):
        delta = np.where(direction != 0, 1.0 / np.abs(direction), np.inf)
        next_wall = np.where(direction != 0, (cell + (step > 0) - origin) / direction, np.inf)
    while True:
        index = (int(cell[0]), int(cell[1]), int(cell[2]))
        if index in drawn:
            return index
        axis = int(np.argmin(next_wall))
        cell[axis] += step[axis]
        next_wall[axis] += delta[axis]
        if not 0 <= cell[axis] < shape[axis]:
            return None


def _enter(origin: NDArray[np.float64], direction: NDArray[np.float64], size: NDArray[np.float64]) -> float | None:
    """Distance at which the ray enters the box from zero to `size`; None when it passes by."""
    with np.errstate(divide="ignore", invalid="ignore"):
        low = np.where(direction != 0, -origin / direction, np.where(origin >= 0, -np.inf, np.inf))
        high = np.where(direction != 0, (size - origin) / direction, np.where(origin <= size, np.inf, -np.inf))
    near = float(np.max(np.minimum(low, high)))
    far = float(np.min(np.maximum(low, high)))
    return None if near > far or far < 0 else max(near, 0.0)

"""Regular grids: linear cell indices in C order of the shape, [i,j,k] indices, and metres."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum, auto
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray


class Extent(Enum):
    """How the cells of a location lie. A plane is no volume of one layer: it is drawn from above."""

    SINGLE = auto()
    PLANE = auto()
    VOLUME = auto()


def three_axes(shape: Sequence[int]) -> tuple[int, int, int]:
    """A shape of one to three axes with three; those it lacks have one cell."""
    nx, ny, nz = (*shape, 1, 1)[:3]
    return nx, ny, nz


def index_of(cell: ArrayLike, shape: Sequence[int]) -> NDArray[np.int64]:
    """Indices [i,j,k], (n, 3), of linear cells (n,) in C order of `shape`.

    >>> index_of([5], [2, 3]).tolist(), index_of([5], [1, 2, 4]).tolist()
    ([[1, 2, 0]], [[0, 1, 1]])
    """
    return np.stack(np.unravel_index(np.asarray(cell, np.int64), three_axes(shape)), axis=-1).astype(np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class CellRuns:
    """Linear cells [start, start + length) for each of start (n,), which ascend and do not overlap."""

    start: NDArray[np.int64]
    length: int

    def chunks(self, size: int) -> NDArray[np.int64]:
        """The chunks of `size` cells each that have some of the cells, ascending."""
        if not self.length or not self.start.size:
            return np.zeros(0, np.int64)
        first, last = self.start // size, (self.start + self.length - 1) // size
        # The ends of spans of chunks: where more have begun than have ended there are some.
        ends = np.zeros(int(last[-1]) + 2, np.int64)
        np.add.at(ends, first, 1)
        np.subtract.at(ends, last + 1, 1)
        return np.flatnonzero(np.cumsum(ends) > 0)

    def among(self, cell: NDArray[np.int64]) -> NDArray[np.int64]:
        """The rows of cells (n,), ascending, that are in a run.

        >>> CellRuns(np.array([2, 10]), 3).among(np.array([1, 3, 4, 5, 12])).tolist()
        [1, 2, 4]
        """
        first, stop = np.searchsorted(cell, self.start), np.searchsorted(cell, self.start + self.length)
        count = stop - first
        return np.asarray(np.repeat(first - np.cumsum(count) + count, count) + np.arange(count.sum()))


@dataclass(frozen=True)
class GridGeometry:
    """Cell [0,0,0] has its lower corner at `origin` (metres, in `frame`); cells are cubes of `resolution_m`.

    >>> grid = GridGeometry("map", (0.0, 0.0, 0.0), 0.5, (4, 3, 2))
    >>> grid.cell([[1, 2, 1]]).tolist(), grid.index([11]).tolist()
    ([11], [[1, 2, 1]])
    """

    frame: str
    origin: tuple[float, float, float]
    resolution_m: float
    shape: tuple[int, ...]

    @cached_property
    def n_cells(self) -> int:
        """Number of cells."""
        return int(np.prod(self.shape, dtype=np.int64))

    @property
    def is_single(self) -> bool:
        """Whether it is no grid but one cell, which nobody has to name."""
        return len(self.shape) == 1

    @property
    def shape3(self) -> tuple[int, int, int]:
        """The shape with three axes; a 2D grid is one layer."""
        return three_axes(self.shape)

    def index(self, cell: ArrayLike) -> NDArray[np.int64]:
        """(n, 3) indices [i,j,k] of linear cells (n,)."""
        return index_of(cell, self.shape)

    def cell(self, index: ArrayLike) -> NDArray[np.int64]:
        """Linear cells (n,) of indices (n, 3). Raises ValueError outside of the grid."""
        i, j, k = np.asarray(index, np.int64).T
        return np.asarray(np.ravel_multi_index((i, j, k), self.shape3), np.int64)

    def centre(self, cell: ArrayLike) -> NDArray[np.float64]:
        """(n, 3) centres in metres."""
        return self.centre_at(self.index(cell))

    def centre_at(self, index: NDArray[np.integer]) -> NDArray[np.float64]:
        """(n, 3) centres in metres of cells with indices (n, 3)."""
        return np.asarray(np.asarray(self.origin) + (index + 0.5) * self.resolution_m, np.float64)

    def bounding_box(self, cell: ArrayLike) -> tuple[float, ...]:
        """[x0, y0, z0, x1, y1, z1] in metres around some cells."""
        return self.box_at(self.index(cell))

    def box_at(self, index: NDArray[np.integer]) -> tuple[float, ...]:
        """The same around cells with indices (n, 3)."""
        corners = [*index.min(axis=0).tolist(), *(index.max(axis=0) + 1).tolist()]
        return tuple(at * self.resolution_m + zero for at, zero in zip(corners, self.origin * 2, strict=True))

    def runs(self, box: tuple[float, ...]) -> CellRuns:
        """The cells with their centre in the box [x0, y0, z0, x1, y1, z1] (metres, closed).

        O(runs), which are at most as many as the box has columns of cells.
        """
        (i, i_stop), (j, j_stop), (k, k_stop) = (self._within(axis, box) for axis in range(3))
        _, ny, nz = self.shape3
        columns, rows = np.arange(i, i_stop)[:, np.newaxis] * ny, np.arange(j, j_stop)
        if k_stop - k < nz:
            return CellRuns(((columns + rows) * nz + k).ravel(), k_stop - k)
        if j_stop - j < ny:
            return CellRuns(((columns + j) * nz).ravel(), (j_stop - j) * nz)
        return CellRuns(columns[:1, 0] * nz, (i_stop - i) * ny * nz)

    def _within(self, axis: int, box: tuple[float, ...]) -> tuple[int, int]:
        """The indices [first, stop) along an axis of the cells with their centre in the box."""
        low, high, zero, n = box[axis], box[axis + 3], self.origin[axis], self.shape3[axis]
        # A little more than the box, for rounding; of that the centres decide.
        first, last = np.clip((np.array([low, high]) - zero) / self.resolution_m + [-2.0, 2.0], -1, n)
        index = np.arange(max(0, int(first)), min(n, int(last) + 1))
        centre = zero + (index + 0.5) * self.resolution_m
        found = index[(centre >= low) & (centre <= high)]
        return (int(found[0]), int(found[-1]) + 1) if found.size else (0, 0)


SINGLE = GridGeometry("", (0.0, 0.0, 0.0), 1.0, (1,))
"""The one cell of a location without a grid."""

NEIGHBOURS = tuple(step for step in product((-1, 0, 1), repeat=3) if step > (0, 0, 0))
"""Half of the 26 neighbours of a cell; the other half are their opposites."""

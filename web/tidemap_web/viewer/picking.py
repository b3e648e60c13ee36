"""Which drawn cell is under the pointer. Cells are drawn as squares that face the camera, so this asks squares."""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from tidemap.space.grid import GridGeometry

Vector = NDArray[np.float64]
STEP = 0.5
"""How finely a ray is followed, in cells."""
_BESIDE = np.array(list(product((-1, 0, 1), repeat=3)))


@dataclass(frozen=True, slots=True, eq=False)
class Ray:
    """From the camera through the pointer, in metres of the scene.

    `origin` and `direction` (3,); `axes` (3, 3) has the camera's right, down and forward as columns.
    """

    origin: Vector
    direction: Vector
    axes: Vector

    @classmethod
    def of(cls, origin: tuple[float, ...], direction: tuple[float, ...], wxyz: NDArray[np.floating]) -> "Ray":
        """A ray of a camera whose orientation is the unit quaternion `wxyz` (4,)."""
        return cls(np.asarray(origin), np.asarray(direction), rotation(np.asarray(wxyz, dtype=np.float64)))

    def moved(self, shift: Vector) -> "Ray":
        """The same ray seen from something that was moved by `shift` (3,)."""
        return Ray(self.origin - shift, self.direction, self.axes)


def first_hit(ray: Ray, centre: Vector, half: float) -> tuple[float, int] | None:
    """Depth and row of the nearest square under a ray, None where there is none.

    `centre` (n, 3) are the squares' centres in metres, `half` is half of their side.

    >>> ahead = Ray(np.zeros(3), np.array([0.0, 0.0, 1.0]), np.eye(3))
    >>> first_hit(ahead, np.array([[0.0, 0.0, 9.0], [0.1, 0.0, 5.0], [2.0, 0.0, 1.0]]), 0.2)
    (5.0, 1)
    """
    right, down, forward = ((centre - ray.origin) @ ray.axes).T
    slope = ray.direction @ ray.axes
    with np.errstate(divide="ignore", invalid="ignore"):
        aside = np.abs(right - forward * (slope[0] / slope[2]))
        above = np.abs(down - forward * (slope[1] / slope[2]))
    under = np.flatnonzero((forward > 0) & (aside <= half) & (above <= half))
    if len(under) == 0:
        return None
    row = int(under[np.argmin(forward[under])])
    return float(forward[row]), row


def cells_near(ray: Ray, grid: GridGeometry) -> NDArray[np.int64]:
    """The cells (n,) whose squares a ray may meet: those it passes and their neighbours.

    A square is no further from its cell's centre than 0.6 cells, and the ray is followed in steps of half a cell.

    >>> grid = GridGeometry("map", (0.0, 0.0, 0.0), 1.0, (9, 9, 9))
    >>> down = Ray(np.array([4.5, 4.5, 50.0]), np.array([0.0, 0.0, -1.0]), np.eye(3))
    >>> near = grid.index(cells_near(down, grid))
    >>> len(near), near.min(axis=0).tolist(), near.max(axis=0).tolist()
    (81, [3, 3, 0], [5, 5, 8])
    """
    shape = np.array(grid.shape3)
    origin = (ray.origin - np.asarray(grid.origin)) / grid.resolution_m
    direction = ray.direction / np.linalg.norm(ray.direction)
    with np.errstate(divide="ignore", invalid="ignore"):
        borders = np.array([-1 - origin, shape + 1 - origin]) / direction
    first, last = max(0.0, np.nanmax(borders.min(axis=0))), np.nanmin(borders.max(axis=0))
    along = np.arange(first, last + STEP, STEP) if first < last else np.zeros(0)
    passed = np.unique(np.floor(origin + along[:, np.newaxis] * direction).astype(np.int64), axis=0)
    near = (passed[:, np.newaxis] + _BESIDE).reshape(-1, 3)
    return np.unique(grid.cell(near[((near >= 0) & (near < shape)).all(axis=1)]))


def rotation(wxyz: Vector) -> Vector:
    """The matrix (3, 3) of a unit quaternion.

    >>> rotation(np.array([1.0, 0.0, 0.0, 0.0])).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    w, x, y, z = wxyz
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )

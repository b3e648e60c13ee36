"""Which drawn cell is under the pointer. Cells are drawn as squares that face the camera, so this asks squares."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


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

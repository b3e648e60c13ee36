"""Poses: rigid transforms from one frame into another."""

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from tidemap.history.jit import kernel

Array: TypeAlias = NDArray[np.float64]

MAX_QUATERNION_ERROR = 0.01
"""How far the norm of a quaternion may be from 1; numbers written with few digits are that close."""
MAX_ROTATION_ERROR = 0.01
"""How far an entry of RᵀR may be from that of the identity."""


@dataclass(frozen=True, slots=True)
class FramedPosition:
    """A point (x, y, z) in metres of a frame."""

    frame: str
    position: tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """The transform `map_from_sensor`: it takes points of the sensor's frame into that of the map.

    rotation (3, 3) float64, orthonormal with determinant 1; translation (3,) float64, metres.

    >>> map_from_robot = Pose.of([1, 2, 0, 0, 0, 1, 0])
    >>> map_from_robot.apply([[1, 0, 0]]).tolist()
    [[0.0, 2.0, 0.0]]
    """

    rotation: Array
    translation: Array

    @classmethod
    def of(cls, values: ArrayLike) -> "Pose":
        """A pose of a matrix (4, 4), or of (x, y, z, qx, qy, qz, qw). Raises ValueError for what is neither."""
        try:
            array = np.asarray(values, np.float64)
        except (TypeError, ValueError):
            raise ValueError("A pose is a 4x4 matrix of numbers, or x, y, z, qx, qy, qz, qw.") from None
        if array.shape == (4, 4):
            return cls.of_matrix(array)
        if array.shape == (7,):
            return cls.of_quaternion(array[:3], array[3:])
        raise ValueError(
            f"The pose has the shape {array.shape}. Send a 4x4 matrix, or the seven numbers x, y, z, qx, qy, qz, qw."
        )

    @classmethod
    def of_matrix(cls, matrix: Array) -> "Pose":
        """A pose of a homogeneous matrix (4, 4); a rotation with rounded numbers becomes the nearest exact one.

        Raises ValueError for what is no rigid transform.
        """
        _require_finite(matrix)
        if not np.array_equal(matrix[3], (0.0, 0.0, 0.0, 1.0)):
            raise ValueError(
                f"The last row of the pose is {matrix[3].tolist()}, but that of a rigid transform is [0, 0, 0, 1]. "
                "Send the matrix by rows, with the translation in its last column."
            )
        return cls(_nearest_rotation(matrix[:3, :3]), matrix[:3, 3].copy())

    @classmethod
    def of_quaternion(cls, translation: ArrayLike, quaternion: ArrayLike) -> "Pose":
        """A pose of a translation (x, y, z) and a quaternion (x, y, z, w) of norm 1, which may have rounded numbers.

        Raises ValueError for what is no rotation.
        """
        translation, quaternion = np.array(translation, np.float64), np.array(quaternion, np.float64)
        _require_finite(translation)
        _require_finite(quaternion)
        if not quaternion.any():
            raise ValueError("The quaternion is (0, 0, 0, 0), which is no rotation. Send (0, 0, 0, 1) for none.")
        norm = math.hypot(*quaternion)
        if abs(norm - 1) > MAX_QUATERNION_ERROR:
            raise ValueError(f"The quaternion has the norm {norm:.6g}, but that of a rotation is 1. Normalise it.")
        return cls(_rotation(quaternion / norm), translation)

    @classmethod
    def of_rotation_vector(cls, vector: ArrayLike, translation: ArrayLike) -> "Pose":
        """A pose of a rotation vector (3,), radians about its own direction, and a translation (3,)."""
        return cls(Rotation.from_rotvec(np.asarray(vector, np.float64)).as_matrix(), np.array(translation, np.float64))

    @property
    def rotation_vector(self) -> Array:
        """The rotation as (3,): its angle in radians about its own direction."""
        return np.asarray(Rotation.from_matrix(self.rotation).as_rotvec(), np.float64)

    @property
    def values(self) -> list[float]:
        """[x, y, z, qx, qy, qz, qw] with qw >= 0; what `of` reads."""
        quaternion = Rotation.from_matrix(self.rotation).as_quat(canonical=True)
        return [*self.translation.tolist(), *quaternion.tolist()]

    @property
    def matrix(self) -> Array:
        """The homogeneous matrix (4, 4)."""
        found = np.eye(4)
        found[:3, :3], found[:3, 3] = self.rotation, self.translation
        return found

    @property
    def inverse(self) -> "Pose":
        """The transform back: `sensor_from_map`."""
        back = self.rotation.T.copy()
        return Pose(back, -back @ self.translation)

    def __matmul__(self, other: "Pose") -> "Pose":
        """First the other, then this: `map_from_robot @ robot_from_sensor` is `map_from_sensor`."""
        return Pose(self.rotation @ other.rotation, self.rotation @ other.translation + self.translation)

    def apply(self, points: ArrayLike) -> Array:
        """Points (n, 3) in the other frame, (n, 3) float64; every row is the same bit for bit in any batch."""
        return _apply(self.rotation, self.translation, np.ascontiguousarray(points, np.float64))


def _require_finite(values: Array) -> None:
    if not np.isfinite(values).all():
        raise ValueError("The pose has values that are NaN or infinite. Leave scans without a known pose out.")


def _nearest_rotation(matrix: Array) -> Array:
    """The rotation (3, 3) closest to a matrix that is nearly one. Raises ValueError for others."""
    # Checked before it is squared: that of a large number is infinite.
    plausible = np.abs(matrix).max() < 2
    if not plausible or np.abs(matrix.T @ matrix - np.eye(3)).max() > MAX_ROTATION_ERROR:
        raise ValueError("The upper left 3x3 of the pose is no rotation: its columns are not orthogonal unit vectors.")
    if np.linalg.det(matrix) < 0:
        raise ValueError("The upper left 3x3 of the pose mirrors; its determinant is -1, but that of a rotation is 1.")
    left, _, right = np.linalg.svd(matrix)
    return np.asarray(left @ right, np.float64)


def _rotation(quaternion: Array) -> Array:
    """The rotation (3, 3) of a quaternion (x, y, z, w) of norm 1."""
    x, y, z, w = quaternion.tolist()
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


@kernel
def _apply(rotation: Array, translation: Array, points: Array) -> Array:
    """R·p + t of every row. No BLAS: its rows differ in the last bits with their number."""
    moved = np.empty_like(points)
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for axis in range(3):
            row = rotation[axis]
            moved[i, axis] = row[0] * x + row[1] * y + row[2] * z + translation[axis]
    return moved

"""Rooms of boxes and sensors in them: exact ranges, and so exact scans, to test registration with."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tidemap.space.pose import Pose

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Room:
    """A box seen from inside and boxes (n, 2, 3) seen from outside: corners low and high, metres."""

    walls: Array
    things: Array

    def ranges(self, pose: Pose, directions: Array) -> Array:
        """How far (n,) it is from a sensor to the first surface along unit directions (n, 3) of its frame."""
        way = directions @ pose.rotation.T
        distance = self._box(self.walls, pose.translation, way)[1]
        for thing in self.things:
            near, far = self._box(thing, pose.translation, way)
            distance = np.where((near <= far) & (near > 0), np.minimum(distance, near), distance)
        return distance

    @staticmethod
    def _box(box: Array, start: Array, way: Array) -> tuple[Array, Array]:
        """When rays enter and leave a box."""
        with np.errstate(divide="ignore", invalid="ignore"):
            times = (box[:, np.newaxis] - start) / way
        return np.nanmax(times.min(axis=0), axis=1), np.nanmin(times.max(axis=0), axis=1)

    def is_free(self, point: Array, margin: float) -> bool:
        """Whether no thing is within a margin of a point."""
        return not any((point > low - margin).all() and (point < high + margin).all() for low, high in self.things)


LAB = Room(
    np.array([[0.013, 0.021, 0.017], [7.82, 5.83, 2.74]]),
    np.array(
        [
            [[1.02, 1.11, 0.0], [1.63, 2.57, 0.78]],
            [[3.31, 0.02, 0.0], [4.42, 0.61, 1.93]],
            [[5.52, 3.03, 0.0], [6.88, 3.81, 0.74]],
            [[2.24, 4.52, 0.0], [2.91, 5.83, 1.27]],
            [[6.93, 0.53, 0.0], [7.55, 1.46, 2.02]],
            [[4.21, 2.33, 0.0], [4.54, 2.66, 2.74]],
        ]
    ),
)
CORRIDOR = Room(np.array([[-40.0, 0.013, 0.017], [40.0, 2.22, 2.74]]), np.zeros((0, 2, 3)))
VIEWS = ((0.6, 0.6), (2.5, 3.2), (3.4, 5.0), (5.0, 1.3), (6.2, 4.9), (6.1, 2.1))
"""Where a sensor may stand in the lab, x and y."""


def level(x: float, y: float, z: float, yaw: float) -> Pose:
    """The pose of a sensor that stands upright."""
    return Pose.of_rotation_vector([0.0, 0.0, yaw], [x, y, z])


def around(n: int, chance: np.random.Generator, width: float = 2 * np.pi, height: float = 1.0) -> Array:
    """Directions (n, 3), spread over a field of view in radians."""
    turn = chance.uniform(-width / 2, width / 2, n)
    rise = chance.uniform(-height / 2, height / 2, n)
    return np.stack([np.cos(turn) * np.cos(rise), np.sin(turn) * np.cos(rise), np.sin(rise)], axis=1)


def in_plane(n: int, width: float = 2 * np.pi) -> Array:
    """Directions (n, 3) of a planar laser."""
    turn = (np.arange(n) + 0.5) / n * width - width / 2
    return np.stack([np.cos(turn), np.sin(turn), np.zeros(n)], axis=1)


def sweep(
    room: Room, pose: Pose, directions: Array, chance: np.random.Generator, noise_m: float = 0.01
) -> NDArray[np.float32]:
    """Points (n, 3) in the sensor's frame, with noise along the rays."""
    distance = room.ranges(pose, directions) + chance.normal(0, noise_m, len(directions))
    return (directions * distance[:, np.newaxis]).astype(np.float32)


def off_by(pose: Pose, shift: Array) -> Pose:
    """A pose shifted (6,) by x, y, z in metres and a rotation vector in radians, in the map's axes."""
    turn = Pose.of_rotation_vector(shift[3:], np.zeros(3)).rotation
    return Pose(turn @ pose.rotation, pose.translation + shift[:3])

"""Sweeps: the ends of a sensor's rays, and the pose that it had."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tidemap.space.pose import Pose
from tidemap.space.ranges import LONGER


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """points (n, 3) float64 in the sensor's frame, metres; rays longer than `max_range_m` hit nothing.

    time: Unix seconds. flat: all points are in one plane with the sensor, as those of a planar laser.
    """

    time: float
    map_from_sensor: Pose
    points: NDArray[np.float64]
    max_range_m: float
    flat: bool

    def ends(self) -> NDArray[np.float64]:
        """All points in the map's frame, (n, 3)."""
        return self.map_from_sensor.apply(self.points)

    def reach(self) -> NDArray[np.float64]:
        """The sensor and all that was hit, in the map's frame, (m, 3)."""
        with np.errstate(invalid="ignore", over="ignore"):
            hit = np.linalg.norm(self.points, axis=1) <= self.max_range_m * LONGER
        return np.concatenate(
            [self.map_from_sensor.translation[np.newaxis], self.map_from_sensor.apply(self.points[hit])]
        )

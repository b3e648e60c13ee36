"""Sweeps: the ends of a sensor's rays, and the pose that it had."""

from dataclasses import dataclass
from math import inf, isfinite

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tidemap.space.pose import Pose


@dataclass(frozen=True, slots=True, eq=False)
class RangeLimits:
    """In metres: nearer ranges are noise, further ones hit nothing."""

    low: float = 0.0
    high: float = inf


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
            hit = np.linalg.norm(self.points, axis=1) <= self.max_range_m
        return np.concatenate(
            [self.map_from_sensor.translation[np.newaxis], self.map_from_sensor.apply(self.points[hit])]
        )


def points_of_ranges(ranges: ArrayLike, angle: NDArray[np.float64], limits: RangeLimits) -> NDArray[np.float64]:
    """Points (m, 3) of ranges (n,) at angles (n,) in the plane of a laser, x forward and y left.

    A range above the highest, infinity too, is a point twice as far away: its ray hits nothing. What is NaN, below the
    lowest, or infinite where there is no highest, is left out.
    """
    found = np.asarray(ranges, np.float64)
    if isfinite(limits.high):
        found = np.where(found > limits.high, 2 * limits.high, found)
    kept = np.isfinite(found) & (found >= limits.low) & (found > 0)
    found, angle = found[kept], angle[kept]
    return np.stack([found * np.cos(angle), found * np.sin(angle), np.zeros(len(found))], axis=1)

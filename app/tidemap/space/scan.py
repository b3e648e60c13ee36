"""Scans: what a sensor measured at once, and the pose that it had."""

from dataclasses import dataclass, replace
from math import inf

import numpy as np
from numpy.typing import NDArray

from tidemap.space.grid import GridGeometry
from tidemap.space.pose import Array, Pose
from tidemap.space.ranges import LONGER
from tidemap.space.rays import SeenCells, cast_rays


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """Points (n, 3) float32 in metres in the sensor's frame, none of them NaN.

    Those further than `max_range_m` are where a ray met nothing up to there. covariance (6, 6) float64 of x, y, z (m)
    and the rotations about the map's x, y, z (rad), None where it is not known. `flat`: all points are in the plane
    z = 0 of the sensor, as those of a planar laser. `min_hits` as in `cast_rays`.
    """

    points: NDArray[np.float32]
    map_from_sensor: Pose
    covariance: Array | None = None
    max_range_m: float = inf
    min_hits: int = 1
    flat: bool = False

    @property
    def returns(self) -> NDArray[np.float32]:
        """The points where something was met: (m, 3)."""
        return self.points[self.ranges <= self.max_range_m * LONGER]

    @property
    def ranges(self) -> NDArray[np.float32]:
        """Distances (n,) from the sensor in metres."""
        with np.errstate(over="ignore"):  # what is too far for float32 is infinitely far
            return np.asarray(np.sqrt(np.einsum("ij,ij->i", self.points, self.points)))

    def at(self, map_from_sensor: Pose) -> "Scan":
        """The same from another pose."""
        return replace(self, map_from_sensor=map_from_sensor)

    def cast(self, grid: GridGeometry) -> SeenCells:
        """The cells of a grid that the scan saw occupied and free."""
        pose = self.map_from_sensor
        ends = pose.apply(self.points)
        return cast_rays(grid, pose.translation, ends, max_range_m=self.max_range_m, min_hits=self.min_hits)

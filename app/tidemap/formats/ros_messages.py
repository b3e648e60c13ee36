"""ROS messages as arrays: whatever has the fields of sensor_msgs/LaserScan, PointCloud2 and nav_msgs/OccupancyGrid."""

from dataclasses import dataclass
from math import inf, isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tidemap.formats.nav2 import states_of_percentages
from tidemap.schemas.ros import cloud_points, map_percent
from tidemap.space.grid import GridGeometry
from tidemap.space.ranges import RangeLimits, measured, points_of_ranges


@dataclass(frozen=True, slots=True, eq=False)
class SensorPoints:
    """points (n, 3) float64 in the sensor's frame, metres; those further than max_range_m hit nothing."""

    points: NDArray[np.float64]
    max_range_m: float
    flat: bool


def stamp(header: Any) -> float:
    """Unix seconds of a header; 0 where it was not set. ROS 1 says secs, ROS 2 sec."""
    moment = header.stamp
    return float(moment.sec) + float(moment.nanosec) / 1e9


def laser_points(message: Any, max_range_m: float = inf) -> SensorPoints:
    """The points of a LaserScan. Raises ValueError."""
    ranges = np.asarray(message.ranges, np.float64)
    low, high = float(message.range_min), float(message.range_max)
    if not high > 0:
        raise ValueError(f"its range_max is {message.range_max}; say the highest range of the laser")
    first, step = float(message.angle_min), float(message.angle_increment)
    if not (isfinite(first) and isfinite(step)):
        raise ValueError("its angles are NaN or infinite")
    angle = first + step * np.arange(len(ranges), dtype=np.float64)
    limits = RangeLimits(low, high, min(high, max_range_m))
    return SensorPoints(points_of_ranges(ranges, angle, limits), limits.clear, flat=True)


def finite_points(message: Any, max_range_m: float = inf) -> SensorPoints:
    """The points of a PointCloud2 that were measured. Raises ValueError."""
    return SensorPoints(measured(cloud_points(message).astype(np.float64)), max_range_m, flat=False)


def occupancy_states(message: Any) -> tuple[GridGeometry, NDArray[np.uint8]]:
    """The grid of an OccupancyGrid and its states (n_cells,), npy.UNSEEN where it is unsure. Raises ValueError.

    Its rows run along x, from the lowest y on; here cells run along y.
    """
    state = states_of_percentages(map_percent(message))
    resolution, at = _short(message.info.resolution), message.info.origin.position
    if not 0 < resolution < inf:
        raise ValueError(f"its resolution is {resolution}")
    height, width = state.shape
    grid = GridGeometry(
        message.header.frame_id.lstrip("/"), (float(at.x), float(at.y), float(at.z)), resolution, (width, height)
    )
    return grid, np.ascontiguousarray(state.T).reshape(-1)


def _short(value: Any) -> float:
    """A float32 as the shortest number that it stands for: .05 rather than .05000000074505806."""
    return float(str(np.float32(value)))

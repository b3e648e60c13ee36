"""ROS messages as arrays: whatever has the fields of sensor_msgs/LaserScan, PointCloud2 and nav_msgs/OccupancyGrid."""

from dataclasses import dataclass
from math import inf, isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tidemap.formats.nav2 import states_of_percentages
from tidemap.space.grid import GridGeometry
from tidemap.space.sweep import RangeLimits, points_of_ranges

FLOATS = {7: "f4", 8: "f8"}
"""By the number of PointField's datatype."""
MAX_YAW = 1e-6
MAX_POINTS = 10_000_000


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
    low, high = float(message.range_min), min(float(message.range_max), max_range_m)
    if not high > 0:
        raise ValueError(f"its range_max is {message.range_max}; say the highest range of the laser")
    first, step = float(message.angle_min), float(message.angle_increment)
    if not (isfinite(first) and isfinite(step)):
        raise ValueError("its angles are NaN or infinite")
    angle = first + step * np.arange(len(ranges), dtype=np.float64)
    return SensorPoints(points_of_ranges(ranges, angle, RangeLimits(low, high)), high, flat=True)


def cloud_points(message: Any, max_range_m: float = inf) -> SensorPoints:
    """The points of a PointCloud2, without those that are NaN. Raises ValueError."""
    width, height = int(message.width), int(message.height)
    step, row = int(message.point_step), int(message.row_step)
    data = np.ascontiguousarray(message.data, np.uint8)
    if not 0 <= width * height <= MAX_POINTS:
        raise ValueError(f"it has {width} x {height} points; at most {MAX_POINTS} are read")
    if width * height == 0:
        return SensorPoints(np.empty((0, 3)), max_range_m, flat=False)
    if row < width * step or len(data) < (height - 1) * row + width * step:
        raise ValueError(f"it has {len(data)} bytes, which is too few for {width} x {height} points of {step} bytes")
    order = ">" if message.is_bigendian else "<"
    axes = [_axis(message.fields, name, order, step) for name in "xyz"]
    columns = [np.ndarray((height, width), dtype, data, offset, (row, step)).reshape(-1) for dtype, offset in axes]
    points = np.stack(columns, axis=1).astype(np.float64)
    return SensorPoints(points[np.isfinite(points).all(axis=1)], max_range_m, flat=False)


def _axis(fields: Any, name: str, order: str, step: int) -> tuple[np.dtype[Any], int]:
    """The type of a coordinate and where it is in a point."""
    found = [each for each in fields if each.name == name]
    if len(found) != 1 or int(found[0].datatype) not in FLOATS:
        raise ValueError(f"it has no field {name} of float32 or float64")
    dtype, offset = np.dtype(order + FLOATS[int(found[0].datatype)]), int(found[0].offset)
    if not 0 <= offset <= step - dtype.itemsize:
        raise ValueError(f"its field {name} is outside of a point")
    return dtype, offset


def occupancy_states(message: Any) -> tuple[GridGeometry, NDArray[np.uint8]]:
    """The grid of an OccupancyGrid and its states (n_cells,), npy.UNSEEN where it is unsure. Raises ValueError.

    Its rows run along x, from the lowest y on; here cells run along y.
    """
    info, header = message.info, message.header
    width, height, resolution = int(info.width), int(info.height), _short(info.resolution)
    data = np.asarray(message.data, np.int8)
    if not (width > 0 and height > 0 and len(data) == width * height):
        raise ValueError(f"it has {len(data)} cells, but declares {width} x {height}")
    if not 0 < resolution < inf:
        raise ValueError(f"its resolution is {resolution}")
    rotation = info.origin.orientation
    if max(abs(rotation.x), abs(rotation.y), abs(rotation.z)) > MAX_YAW:
        raise ValueError("its origin is turned, but cells lie along the axes. Publish the map with a yaw of 0")
    state = states_of_percentages(data)
    at = info.origin.position
    grid = GridGeometry(
        header.frame_id.lstrip("/"), (float(at.x), float(at.y), float(at.z)), resolution, (width, height)
    )
    return grid, np.ascontiguousarray(state.reshape(height, width).T).reshape(-1)


def _short(value: Any) -> float:
    """A float32 as the shortest number that it stands for: .05 rather than .05000000074505806."""
    return float(str(np.float32(value)))

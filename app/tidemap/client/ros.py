"""Messages of ROS by their shape: read and made without ROS, for any library that has the same fields."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

UNKNOWN = -1
"""Of a cell in a map."""


@dataclass(slots=True)
class Stamp:
    """Shaped like builtin_interfaces/Time."""

    sec: int = 0
    nanosec: int = 0

    @classmethod
    def of(cls, time_s: float) -> "Stamp":
        """Unix seconds."""
        whole = math.floor(time_s)
        return cls(whole, min(999_999_999, round((time_s - whole) * 1e9)))


@dataclass(slots=True)
class Header:
    """Shaped like std_msgs/Header."""

    stamp: Stamp = field(default_factory=Stamp)
    frame_id: str = "map"


@dataclass(slots=True)
class Point:
    """Shaped like geometry_msgs/Point."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


@dataclass(slots=True)
class Quaternion:
    """Shaped like geometry_msgs/Quaternion."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0


@dataclass(slots=True)
class PoseMessage:
    """Shaped like geometry_msgs/Pose."""

    position: Point = field(default_factory=Point)
    orientation: Quaternion = field(default_factory=Quaternion)


@dataclass(slots=True)
class MapMetaData:
    """Shaped like nav_msgs/MapMetaData."""

    map_load_time: Stamp
    resolution: float
    width: int
    height: int
    origin: PoseMessage


@dataclass(slots=True, eq=False)
class OccupancyGrid:
    """Shaped like nav_msgs/OccupancyGrid: `data` (height * width,) int8, rows of one y from the lower left on.

    0 to 100 is the probability of being occupied in percent, -1 unknown.
    """

    header: Header
    info: MapMetaData
    data: NDArray[np.int8]


def is_laser_scan(message: object) -> bool:
    """Whether something has the fields of sensor_msgs/LaserScan."""
    return all(hasattr(message, name) for name in ("ranges", "angle_min", "angle_increment", "range_max"))


def is_point_cloud(message: object) -> bool:
    """Whether something has the fields of sensor_msgs/PointCloud2."""
    return all(hasattr(message, name) for name in ("fields", "point_step", "row_step", "data"))


def is_occupancy_grid(message: object) -> bool:
    """Whether something has the fields of nav_msgs/OccupancyGrid."""
    return hasattr(message, "info") and hasattr(message, "data")


def pose_of(pose: Any) -> list[Any]:
    """A pose (4, 4) or (x, y, z, qx, qy, qz, qw), or shaped like geometry_msgs/Transform or Pose, as plain numbers."""
    inner = getattr(pose, "transform", getattr(pose, "pose", pose))
    shift = getattr(inner, "translation", getattr(inner, "position", None))
    rotation = getattr(inner, "rotation", getattr(inner, "orientation", None))
    if shift is not None and rotation is not None:
        return [*(getattr(shift, axis) for axis in "xyz"), *(getattr(rotation, axis) for axis in "xyzw")]
    values = np.asarray(pose, np.float64)
    if values.shape not in ((4, 4), (7,)):
        raise ValueError(f"a pose is a 4x4 matrix or x, y, z, qx, qy, qz, qw; this has the shape {values.shape}")
    return list(values.tolist())

"""Messages of ROS by their shape: read and made without ROS, for any library that has the same fields."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

FLOATS = {7: "f4", 8: "f8"}
"""Of sensor_msgs/PointField the types that coordinates have."""
MAX_SINE = 1e-6
"""How far the origin of a map may be rotated, the sine of half the angle: not at all, but for rounding."""
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


def points_of(message: Any) -> NDArray[np.float32]:
    """Points (n, 3) of a sensor_msgs/PointCloud2. Raises ValueError where x, y and z are no floats in it."""
    order = ">" if message.is_bigendian else "<"
    fields = {each.name: each for each in message.fields}
    if any(name not in fields or fields[name].datatype not in FLOATS for name in "xyz"):
        raise ValueError(f"the cloud has the fields {list(fields)}; x, y and z must be there as float32 or float64")
    layout = np.dtype(
        {
            "names": list("xyz"),
            "formats": [order + FLOATS[fields[name].datatype] for name in "xyz"],
            "offsets": [fields[name].offset for name in "xyz"],
            "itemsize": message.point_step,
        }
    )
    shape, strides = (message.height, message.width), (message.row_step, message.point_step)
    content = np.frombuffer(bytes(message.data), np.uint8)
    if message.height and len(content) < (message.height - 1) * message.row_step + message.width * message.point_step:
        raise ValueError(f"the cloud declares {message.height} x {message.width} points, but its data is too short")
    rows = np.ndarray(shape, layout, content, 0, strides)
    return np.stack([rows[name].ravel().astype(np.float32) for name in "xyz"], axis=1)


def states_of(message: Any) -> NDArray[np.int8]:
    """Cells (height, width) of a nav_msgs/OccupancyGrid: percent, -1 unknown. Raises ValueError for a rotated one."""
    rotation = message.info.origin.orientation
    if max(abs(getattr(rotation, axis)) for axis in "xyz") > MAX_SINE:
        raise ValueError(
            "the origin of this map is rotated, and cells here are not: resample it, or make its frame the location's"
        )
    return np.asarray(message.data, np.int8).reshape(message.info.height, message.info.width)


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

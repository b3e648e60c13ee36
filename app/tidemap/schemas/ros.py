"""Messages of ROS as arrays, of any library that has their fields: what client and server read the same."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

FLOATS = {7: "f4", 8: "f8"}
"""Of sensor_msgs/PointField the types that coordinates have."""
MAX_POINTS = 10_000_000
MAX_PERCENT, UNSIGNED = 100, 255
"""The highest value of a cell in a map, and -1 as a byte without a sign."""
MAX_SINE = 1e-6
"""How far the origin of a map may be rotated, the sine of half the angle: not at all, but for rounding."""


def cloud_points(message: Any) -> NDArray[np.floating]:
    """Points (n, 3) of a sensor_msgs/PointCloud2, as float32 or float64 like x, y and z in it. Raises ValueError."""
    width, height = int(message.width), int(message.height)
    step, row = int(message.point_step), int(message.row_step)
    content = np.frombuffer(bytes(message.data), np.uint8)
    if not 0 <= width * height <= MAX_POINTS:
        raise ValueError(f"it has {width} x {height} points; at most {MAX_POINTS} are read")
    order = ">" if message.is_bigendian else "<"
    axes = [_axis(message.fields, name, order, step) for name in "xyz"]
    if width * height == 0:
        return np.empty((0, 3), np.float32)
    if row < width * step or len(content) < (height - 1) * row + width * step:
        raise ValueError(f"it has {len(content)} bytes, which is too few for {width} x {height} points of {step} bytes")
    columns = [np.ndarray((height, width), dtype, content, offset, (row, step)).reshape(-1) for dtype, offset in axes]
    native = np.result_type(*(dtype.newbyteorder("=") for dtype, _ in axes))
    return np.stack(columns, axis=1).astype(native, copy=False)


def _axis(fields: Any, name: str, order: str, step: int) -> tuple[np.dtype[Any], int]:
    """The type of a coordinate and where it is in a point."""
    found = [each for each in fields if each.name == name]
    if len(found) != 1 or int(found[0].datatype) not in FLOATS:
        names = [str(each.name)[:40] for each in fields][:20]
        raise ValueError(f"it has no field {name} of float32 or float64; its fields are {names}")
    dtype, offset = np.dtype(order + FLOATS[int(found[0].datatype)]), int(found[0].offset)
    if not 0 <= offset <= step - dtype.itemsize:
        raise ValueError(f"its field {name} is outside of a point")
    return dtype, offset


def map_percent(message: Any) -> NDArray[np.int8]:
    """Cells (height, width) of a nav_msgs/OccupancyGrid: percent, -1 unknown. Raises ValueError."""
    width, height = int(message.info.width), int(message.info.height)
    data = np.asarray(message.data)
    if not (width > 0 and height > 0 and data.shape == (width * height,)):
        raise ValueError(f"it has {data.size} cells, but declares {width} x {height}")
    rotation = message.info.origin.orientation
    if not all(abs(getattr(rotation, axis)) <= MAX_SINE for axis in "xyz"):
        raise ValueError(
            "its origin is rotated, and cells here are not. Publish the map with a yaw of 0, resample it, or make its "
            "frame the location's"
        )
    return percentages(data).reshape(height, width)


def percentages(values: NDArray[Any]) -> NDArray[np.int8]:
    """Cells of any shape in percent, -1 where they are unknown, or 255 where bytes have no sign. Raises ValueError."""
    if values.dtype.kind not in "iu" or not (((values >= -1) & (values <= MAX_PERCENT)) | (values == UNSIGNED)).all():
        raise ValueError(f"its cells are not all whole numbers, 0 to {MAX_PERCENT} percent or -1")
    return values.astype(np.int8)  # 255 becomes -1

"""Messages shaped as those of ROS, made without it."""

from types import SimpleNamespace as Shape
from typing import Any

import numpy as np

FLOAT32, FLOAT64 = 7, 8


def stamp(sec: int = 1_700_000_000, nanosec: int = 250_000_000) -> Any:
    return Shape(sec=sec, nanosec=nanosec)


def laser_scan(ranges: Any, **changes: Any) -> Any:
    """A sensor_msgs/LaserScan."""
    fields = {
        "header": Shape(stamp=stamp(), frame_id="laser"),
        "angle_min": 0.0,
        "angle_max": 1.0,
        "angle_increment": 0.5,
        "time_increment": 0.0,
        "scan_time": 0.1,
        "range_min": 0.1,
        "range_max": 8.0,
        "ranges": ranges,
        "intensities": [],
    }
    return Shape(**{**fields, **changes})


def point_cloud(points: Any, datatype: int = FLOAT32, *, big: bool = False, padding: int = 4, rows: int = 1) -> Any:
    """A sensor_msgs/PointCloud2 of points (n, 3) with an intensity in front, in so many rows with padding."""
    kind = (">" if big else "<") + {FLOAT32: "f4", FLOAT64: "f8"}[datatype]
    size = np.dtype(kind).itemsize
    offsets = [0, 4, 4 + size, 4 + 2 * size]
    layout = np.dtype(
        {"names": list("ixyz"), "formats": ["u1"] + [kind] * 3, "offsets": offsets, "itemsize": 8 + 3 * size}
    )
    table = np.zeros(len(points), layout)
    for axis, column in zip("xyz", np.asarray(points).T, strict=True):
        table[axis] = column
    width = len(points) // rows
    data = b"".join(table[i * width : (i + 1) * width].tobytes() + bytes(padding) for i in range(rows))
    fields = [
        Shape(name=name, offset=offset, datatype=datatype, count=1)
        for name, offset in zip("xyz", offsets[1:], strict=True)
    ]
    return Shape(
        header=Shape(stamp=stamp(), frame_id="camera"),
        height=rows,
        width=width,
        fields=[Shape(name="i", offset=0, datatype=2, count=1), *fields],
        is_bigendian=big,
        point_step=layout.itemsize,
        row_step=layout.itemsize * width + padding,
        data=data,
        is_dense=True,
    )


def occupancy_grid(percent: Any, yaw: float = 0.0) -> Any:
    """A nav_msgs/OccupancyGrid of cells (height, width)."""
    cells = np.asarray(percent)
    turn = Shape(x=0.0, y=0.0, z=float(np.sin(yaw / 2)), w=float(np.cos(yaw / 2)))
    origin = Shape(position=Shape(x=0.0, y=0.0, z=0.0), orientation=turn)
    info = Shape(resolution=0.5, width=cells.shape[1], height=cells.shape[0], origin=origin)
    return Shape(header=Shape(stamp=stamp(), frame_id="map"), info=info, data=cells.ravel().tolist())

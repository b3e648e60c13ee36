"""Bags of a small robot, written by rosbags: the arrays that they hold are known."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

KINDS = ("ros1", "db3", "mcap")
START = 1_767_225_600
"""2026-01-01, 00:00 UTC."""
LASER, CLOUD, BOOL, TEXT, MAP, ODOMETRY = "/scan", "/points", "/door", "/door_text", "/map", "/odom"
Quaternion = tuple[float, float, float, float]


def turned(yaw: float) -> Quaternion:
    return (0.0, 0.0, float(np.sin(yaw / 2)), float(np.cos(yaw / 2)))


def in_nanoseconds(time: float) -> int:
    """Exactly: their number is too large for a float."""
    return int(time) * 10**9 + round(time % 1 * 1e9)


class BagWriter:
    """Writes messages of plain values to a bag of one kind."""

    def __init__(self, writer: Any, kind: str) -> None:
        self._writer = writer
        self._ros1 = kind == "ros1"
        self._store = get_typestore(Stores.ROS1_NOETIC if self._ros1 else Stores.ROS2_HUMBLE)
        # A real bag brings its definition along.
        self._store.register(
            get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage")
        )
        self._connections: dict[str, Any] = {}

    def make(self, kind: str, **fields: Any) -> Any:
        package, name = kind.split("/")
        return self._store.types[f"{package}/msg/{name}"](**fields)

    def header(self, time: float, frame: str) -> Any:
        nanoseconds = in_nanoseconds(time)
        stamp = self.make("builtin_interfaces/Time", sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
        return self.make("std_msgs/Header", stamp=stamp, frame_id=frame, **({"seq": 0} if self._ros1 else {}))

    def write(self, topic: str, message: Any, time: float) -> None:
        kind = message.__msgtype__
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(topic, kind, typestore=self._store)
        serialize = self._store.serialize_ros1 if self._ros1 else self._store.serialize_cdr
        self._writer.write(self._connections[topic], in_nanoseconds(time), serialize(message, kind))

    def transform(
        self, time: float, parent: str, child: str, move: NDArray[np.float64], turn: Quaternion, topic: str = "/tf"
    ) -> None:
        x, y, z = map(float, move)
        qx, qy, qz, qw = turn
        transform = self.make(
            "geometry_msgs/Transform",
            translation=self.make("geometry_msgs/Vector3", x=x, y=y, z=z),
            rotation=self.make("geometry_msgs/Quaternion", x=qx, y=qy, z=qz, w=qw),
        )
        stamped = self.make(
            "geometry_msgs/TransformStamped",
            header=self.header(time, parent),
            child_frame_id=child,
            transform=transform,
        )
        self.write(topic, self.make("tf2_msgs/TFMessage", transforms=[stamped]), time)

    def pose(self, move: NDArray[np.float64], turn: Quaternion) -> Any:
        x, y, z = map(float, move)
        qx, qy, qz, qw = turn
        return self.make(
            "geometry_msgs/Pose",
            position=self.make("geometry_msgs/Point", x=x, y=y, z=z),
            orientation=self.make("geometry_msgs/Quaternion", x=qx, y=qy, z=qz, w=qw),
        )

    def odometry(self, time: float, parent: str, child: str, move: NDArray[np.float64], turn: Quaternion) -> None:
        zero = self.make("geometry_msgs/Vector3", x=0.0, y=0.0, z=0.0)
        twist = self.make("geometry_msgs/Twist", linear=zero, angular=zero)
        message = self.make(
            "nav_msgs/Odometry",
            header=self.header(time, parent),
            child_frame_id=child,
            pose=self.make("geometry_msgs/PoseWithCovariance", pose=self.pose(move, turn), covariance=np.zeros(36)),
            twist=self.make("geometry_msgs/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
        )
        self.write(ODOMETRY, message, time)

    def laser(
        self, time: float, frame: str, ranges: NDArray[np.float32], first: float, step: float, **more: Any
    ) -> None:
        limits = {"range_min": 0.1, "range_max": 10.0} | more
        message = self.make(
            "sensor_msgs/LaserScan",
            header=self.header(time, frame),
            angle_min=first,
            angle_max=first + step * (len(ranges) - 1),
            angle_increment=step,
            time_increment=0.0,
            scan_time=0.1,
            ranges=ranges.astype(np.float32),
            intensities=np.zeros(0, np.float32),
            **limits,
        )
        self.write(LASER, message, time)

    def cloud(self, time: float, frame: str, points: NDArray[np.float32]) -> None:
        """Points with a field in front of z, as drivers have it."""
        rows = np.zeros(len(points), np.dtype([("x", "<f4"), ("y", "<f4"), ("intensity", "<f4"), ("z", "<f4")]))
        for axis, name in enumerate("xyz"):
            rows[name] = points[:, axis]
        fields = [
            self.make("sensor_msgs/PointField", name=name, offset=4 * at, datatype=7, count=1)
            for at, name in enumerate(rows.dtype.names or ())
        ]
        message = self.make(
            "sensor_msgs/PointCloud2",
            header=self.header(time, frame),
            height=1,
            width=len(points),
            fields=fields,
            is_bigendian=False,
            point_step=16,
            row_step=16 * len(points),
            data=np.frombuffer(rows.tobytes(), np.uint8),
            is_dense=False,
        )
        self.write(CLOUD, message, time)

    def occupancy(
        self,
        time: float,
        frame: str,
        data: NDArray[np.int8],
        resolution: float,
        at: NDArray[np.float64],
        turn: Quaternion,
    ) -> None:
        """data (height, width) as ROS has it: rows along x, from the lowest y on."""
        height, width = data.shape
        info = self.make(
            "nav_msgs/MapMetaData",
            map_load_time=self.header(time, frame).stamp,
            resolution=resolution,
            width=width,
            height=height,
            origin=self.pose(at, turn),
        )
        header = self.header(time, frame)
        self.write(MAP, self.make("nav_msgs/OccupancyGrid", header=header, info=info, data=data.reshape(-1)), time)

    def door(self, time: float, is_open: bool) -> None:
        self.write(BOOL, self.make("std_msgs/Bool", data=is_open), time)
        self.write(TEXT, self.make("std_msgs/String", data="ajar" if is_open else "shut"), time)


@contextmanager
def bag(folder: Path, kind: str) -> Iterator[tuple[Path, BagWriter]]:
    """A new bag to write to."""
    if kind == "ros1":
        path = folder / "robot.bag"
        with Writer1(path) as writer1:
            yield path, BagWriter(writer1, kind)
        return
    path = folder / f"robot_{kind}"
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    with Writer2(path, version=9, storage_plugin=plugin) as writer2:
        yield path, BagWriter(writer2, kind)

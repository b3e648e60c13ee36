"""A robot beside the node: it does what each line of its input says, and answers each with a line, both JSON."""

import json
import struct
import sys
import time
from array import array
from collections.abc import Callable
from typing import Any

import rclpy
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import OccupancyGrid
from nav_msgs.srv import GetMap
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import LaserScan, PointCloud2, PointField
from std_msgs.msg import Bool, Header

WAIT_S = 60.0
POINT = struct.Struct("<fff")
LATER_S = 0.3
"""So much after a scan comes its transform, as on a robot."""


class Robot:
    """A node with the sensors of a robot, and a planner's ear for maps."""

    def __init__(self) -> None:
        rclpy.init()
        self.node = Node("robot")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.scans = self.node.create_publisher(LaserScan, "scan", qos_profile_sensor_data)
        self.clouds = self.node.create_publisher(PointCloud2, "points", qos_profile_sensor_data)
        self.doors = self.node.create_publisher(Bool, "door", 10)
        self.transforms = self.node.create_publisher(TransformStamped, "/tf", 100)

    def until(self, done: Callable[[], object]) -> None:
        """Spin until something is so."""
        deadline = time.monotonic() + WAIT_S
        while not done():
            if time.monotonic() > deadline:
                raise TimeoutError
            self.executor.spin_once(timeout_sec=0.05)

    def scan(self, said: dict[str, Any]) -> None:
        """Publish a laser scan, and afterwards its transform, unless it has no pose."""
        self.until(self.scans.get_subscription_count)
        scan = LaserScan()
        fill(scan.header, said["stamp"], "laser")
        scan.angle_min, scan.angle_increment = said["angle_min"], said["angle_increment"]
        scan.range_min, scan.range_max = said["range_min"], said["range_max"]
        scan.ranges = [float(each) for each in said["ranges"]]
        self.scans.publish(scan)
        if said["pose"] is not None:
            self._transform(said, "laser")

    def cloud(self, said: dict[str, Any]) -> None:
        """Publish a cloud of points, and afterwards its transform."""
        self.until(self.clouds.get_subscription_count)
        cloud = PointCloud2()
        fill(cloud.header, said["stamp"], "camera")
        cloud.height, cloud.width = 1, len(said["points"])
        cloud.point_step, cloud.row_step = POINT.size, POINT.size * cloud.width
        cloud.fields = [PointField(name=axis, offset=4 * i, datatype=7, count=1) for i, axis in enumerate("xyz")]
        cloud.data = array("B", b"".join(POINT.pack(*point) for point in said["points"]))
        self.clouds.publish(cloud)
        self._transform(said, "camera")

    def _transform(self, said: dict[str, Any], frame: str) -> None:
        self.until(self.transforms.get_subscription_count)
        time.sleep(LATER_S)
        stamped = TransformStamped()
        fill(stamped.header, said["stamp"], "map")
        stamped.child_frame_id = frame
        pose = stamped.transform
        for part, axes, values in ((pose.translation, "xyz", said["pose"]), (pose.rotation, "xyzw", said["pose"][3:])):
            for axis, value in zip(axes, values, strict=False):
                setattr(part, axis, value)
        self.transforms.publish(stamped)

    def door(self, said: dict[str, Any]) -> None:
        """Publish whether a door is open."""
        self.until(self.doors.get_subscription_count)
        message = Bool()
        message.data = said["open"]
        self.doors.publish(message)

    def map(self, said: dict[str, Any]) -> dict[str, Any]:
        """The first map that comes to a new subscriber, as Nav2's static layer subscribes."""
        heard: list[OccupancyGrid] = []
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        subscription = self.node.create_subscription(OccupancyGrid, "map", heard.append, latched)
        self.until(lambda: heard)
        self.node.destroy_subscription(subscription)
        return as_values(heard[0])

    def get_map(self, said: dict[str, Any]) -> dict[str, Any]:
        """The map that the service answers."""
        client = self.node.create_client(GetMap, "/tidemap/map")
        self.until(client.service_is_ready)
        future = client.call_async(GetMap.Request())
        self.until(future.done)
        return as_values(future.result().map)


def fill(header: Header, stamp: list[int], frame: str) -> None:
    """Seconds and nanoseconds, and the frame."""
    header.frame_id = frame
    header.stamp.sec, header.stamp.nanosec = stamp


def as_values(grid: OccupancyGrid) -> dict[str, Any]:
    """A map as plain values."""
    origin = grid.info.origin
    return {
        "frame": grid.header.frame_id,
        "stamp": [grid.header.stamp.sec, grid.header.stamp.nanosec],
        "resolution": grid.info.resolution,
        "shape": [grid.info.height, grid.info.width],
        "origin": [origin.position.x, origin.position.y, origin.position.z, origin.orientation.w],
        "data": grid.data.tolist(),
    }


def main() -> None:
    """Answer until the input ends."""
    robot = Robot()
    for line in sys.stdin:
        said = json.loads(line)
        print(json.dumps(getattr(robot, said["do"])(said)), flush=True)


if __name__ == "__main__":
    main()

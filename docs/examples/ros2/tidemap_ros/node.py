"""Tidemap beside Nav2: what a robot sees goes in through an outbox, the predicted map comes out on a latched topic."""

import os
from collections import deque

import rclpy
from nav_msgs.msg import OccupancyGrid
from nav_msgs.srv import GetMap
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from rclpy.time import Time
from sensor_msgs.msg import LaserScan, PointCloud2
from std_msgs.msg import Bool
from tf2_ros import Buffer, TransformException, TransformListener

from tidemap import Client
from tidemap.client import OutboxError, RetryPolicy, TidemapError
from tidemap_ros.messages import fill_map
from tidemap_ros.options import Options

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
MAX_WAITING = 64
"""Scans whose transform is not known yet; the oldest give way."""
LOG_S = 30.0
"""Between two lines of the log about the same."""


class TidemapNode(Node):
    """Posts what it sees to one location, and publishes the map that is expected there."""

    def __init__(self) -> None:
        super().__init__("tidemap")
        self.options = Options.of(self)
        url, once = self.options.url, RetryPolicy(tries=1)
        self.robot = Client(url, os.environ.get("ROBOT_KEY"), outbox=self.options.outbox)
        self.reader = Client(url, os.environ.get("OPERATOR_KEY"), timeout_s=self.options.timeout_s, retry=once)
        self.map = OccupancyGrid()
        self.map_due = 0.0
        self.waiting: deque[LaserScan | PointCloud2] = deque(maxlen=MAX_WAITING)
        self.taken: dict[type[LaserScan | PointCloud2], float] = {}
        self.buffer = Buffer()
        self.listener = TransformListener(self.buffer, self)
        self.publisher = self.create_publisher(OccupancyGrid, "map", LATCHED)
        # A question may wait for the server; sensors do not wait for it.
        sensors, maps = MutuallyExclusiveCallbackGroup(), MutuallyExclusiveCallbackGroup()
        self.create_subscription(LaserScan, "scan", self.take, qos_profile_sensor_data, callback_group=sensors)
        self.create_subscription(PointCloud2, "points", self.take, qos_profile_sensor_data, callback_group=sensors)
        if self.options.door:
            self.create_subscription(Bool, "door", self.post_door, 10, callback_group=sensors)
        self.create_timer(0.05, self.post_scans, callback_group=sensors)
        self.create_timer(0.5, self.publish_map, callback_group=maps)
        self.create_service(GetMap, "~/map", self.answer)

    def now(self) -> float:
        """Unix seconds; simulated ones with `use_sim_time`."""
        return float(self.get_clock().now().nanoseconds) / 1e9

    def take(self, scan: LaserScan | PointCloud2) -> None:
        """Keep a scan until its transform is known; of each kind one a period."""
        time = Time.from_msg(scan.header.stamp).nanoseconds / 1e9
        # A recording that begins again goes back in time.
        if not 0 <= time - self.taken.get(type(scan), -1e18) < self.options.scan_period_s:
            self.taken[type(scan)] = time
            self.waiting.append(scan)

    def post_scans(self) -> None:
        """Post those whose transform is known, at the stamp and not just the latest one."""
        while self.waiting:
            scan = self.waiting[0]
            time = Time.from_msg(scan.header.stamp)
            try:
                pose = self.buffer.lookup_transform(self.options.frame, scan.header.frame_id, time)
                self.robot.location(self.options.location).observe_scan(
                    scan,
                    pose,
                    covariance=self.options.covariance,
                    max_range=self.options.max_range_m or None,
                    frame=self.options.frame,
                )
            except TransformException as error:
                ahead = time.nanoseconds / 1e9 - self.now()
                if abs(ahead) < self.options.tf_wait_s:
                    return
                # No clock waits for it, or a recording began again and has forgotten its transform.
                why = f"its stamp is {ahead:.1f} s ahead of the clock: {error}" if ahead > 0 else str(error)
                self.get_logger().warning(f"A scan is dropped: {why}", throttle_duration_sec=LOG_S)
            except (OutboxError, ValueError) as error:
                self.get_logger().error(f"A scan is dropped: {error}", throttle_duration_sec=LOG_S)
            self.waiting.popleft()

    def post_door(self, door: Bool) -> None:
        """Post a state: true is occupied."""
        try:
            self.robot.location(self.options.door).observe(self.now(), int(door.data))
        except OutboxError as error:
            self.get_logger().error(f"A state is dropped: {error}", throttle_duration_sec=LOG_S)

    def publish_map(self) -> None:
        """Publish the map once a period; out of reach of the server the one before stays."""
        now = self.now()
        if 0 <= self.map_due - now <= self.options.map_period_s:
            return
        self.map_due = now + self.options.map_period_s
        if refused := len(self.robot.outbox.refused()):
            self.get_logger().warning(f"The server refused {refused} posts: tidemap outbox list {self.options.outbox}")
        try:
            location = self.reader.location(self.options.location)
            state = location.state(now + self.options.ahead_s, confidence=self.options.confidence or None)
            grid = state.to_occupancy_grid(self.options.z_min, self.options.z_max, mode="trinary")
        except (TidemapError, ValueError) as error:
            self.get_logger().warning(f"No new map: {error}", throttle_duration_sec=LOG_S)
            return
        self.map = fill_map(OccupancyGrid(), grid)
        self.publisher.publish(self.map)

    def answer(self, _: GetMap.Request, response: GetMap.Response) -> GetMap.Response:
        """The map that was published last; an empty one before."""
        response.map = self.map
        return response

    def close(self) -> None:
        """What was not sent yet stays in the outbox."""
        self.robot.close()
        self.reader.close()


def main() -> None:
    """Run the node until it is stopped."""
    rclpy.init()
    node = TidemapNode()
    executor = MultiThreadedExecutor(num_threads=3)
    executor.add_node(node)
    try:
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.close()
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()

"""A stand-in for tf2_ros, for which there is no wheel: it knows a transform at the times at which it was sent alone.

It hears `geometry_msgs/TransformStamped`, one at a time, for there is no wheel of tf2_msgs either.
"""

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.time import Time

__all__ = ["Buffer", "TransformException", "TransformListener"]


class TransformException(Exception):  # noqa: N818
    """What tf2_ros raises for a transform that it does not know, or not at that time."""


class Buffer:
    """The transforms that were heard."""

    def __init__(self) -> None:
        self._heard: dict[tuple[str, str, int], TransformStamped] = {}

    def set_transform(self, transform: TransformStamped) -> None:
        """Know one more."""
        time = Time.from_msg(transform.header.stamp).nanoseconds
        self._heard[transform.header.frame_id, transform.child_frame_id, time] = transform

    def lookup_transform(self, target_frame: str, source_frame: str, time: Time) -> TransformStamped:
        """The transform that takes points of the source frame into the target frame. Raises TransformException."""
        try:
            return self._heard[target_frame, source_frame, time.nanoseconds]
        except KeyError:
            raise TransformException(
                f"no transform from {source_frame} to {target_frame} at {time.nanoseconds}"
            ) from None


class TransformListener:
    """Fills a buffer with what a node hears on /tf."""

    def __init__(self, buffer: Buffer, node: Node) -> None:
        node.create_subscription(TransformStamped, "/tf", buffer.set_transform, 100)

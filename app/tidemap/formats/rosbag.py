"""Bags of ROS 1 (.bag) and ROS 2 (folders, .db3, .mcap), read with rosbags."""

from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tidemap.errors import UnreadableBodyError
from tidemap.formats.ros_messages import stamp
from tidemap.space.transforms import TransformTree

TRANSFORMS = {"tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"}
STATIC = "/tf_static"
SUFFIXES = {".bag", ".db3", ".mcap"}
ODOMETRY = "nav_msgs/msg/Odometry"
POSES = {ODOMETRY, "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped"}


@dataclass(frozen=True, slots=True)
class BagTopic:
    """A topic with its type, such as sensor_msgs/msg/LaserScan, and how many messages it has."""

    name: str
    type: str
    n_messages: int


@dataclass(frozen=True, slots=True, eq=False)
class BagMessage:
    """A message with the time (Unix seconds) at which it was recorded."""

    topic: BagTopic
    recorded: float
    content: Any


class Bag:
    """A bag that is open. Everything raises UnreadableBodyError for what is damaged."""

    def __init__(self, path: Path) -> None:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        with _readable(), ExitStack() as opened:
            reader = AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
            self._reader = opened.enter_context(reader)
            self.topics = {
                name: BagTopic(name, info.msgtype or "several types", info.msgcount)
                for name, info in self._reader.topics.items()
            }
            self._stack = opened.pop_all()

    def __enter__(self) -> "Bag":
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def messages(self, topics: Collection[str]) -> Iterator[BagMessage]:
        """The messages of some topics, which it has, as they were recorded."""
        with _readable():
            chosen = [each for each in self._reader.connections if each.topic in topics]
            n = 0
            for connection, nanoseconds, raw in self._reader.messages(chosen) if chosen else ():
                content = self._reader.deserialize(raw, connection.msgtype)
                recorded = nanoseconds // 10**9 + nanoseconds % 10**9 / 1e9
                yield BagMessage(self.topics[connection.topic], recorded, content)
                n += 1
        if n != (declared := sum(self.topics[name].n_messages for name in topics)):
            raise unreadable(
                f"it declares {declared} messages of {', '.join(sorted(topics))}, and has {n}. Copy it again"
            )

    def transforms(self, pose_topics: Collection[str], robot_frame: str) -> TransformTree:
        """All transforms of tf, tf_static, and of topics of a type in POSES, which are those of the robot."""
        tree = TransformTree()
        topics = {each.name for each in self.topics.values() if each.type in TRANSFORMS} | set(pose_topics)
        for message in self.messages(topics):
            try:
                _add(tree, message, robot_frame)
            except ValueError as error:
                raise unreadable(f"a transform of {message.topic.name} is wrong: {error}") from None
        return tree


def _add(tree: TransformTree, message: BagMessage, robot_frame: str) -> None:
    if message.topic.type in TRANSFORMS:
        for each in message.content.transforms:
            time = None if message.topic.name.endswith(STATIC) else stamp(each.header)
            move, rotation = each.transform.translation, each.transform.rotation
            tree.add(each.header.frame_id, each.child_frame_id, time, *_numbers(move, rotation))
        return
    header, pose = message.content.header, message.content.pose
    child = message.content.child_frame_id if message.topic.type == ODOMETRY else ""
    pose = getattr(pose, "pose", pose)  # with a covariance it is one level down
    tree.add(header.frame_id, child or robot_frame, stamp(header), *_numbers(pose.position, pose.orientation))


def _numbers(move: Any, rotation: Any) -> tuple[list[float], list[float]]:
    return [move.x, move.y, move.z], [rotation.x, rotation.y, rotation.z, rotation.w]


def unreadable(why: str) -> UnreadableBodyError:
    """What is raised for a bag that cannot be read."""
    return UnreadableBodyError(f"This bag cannot be read: {why}.")


@contextmanager
def _readable() -> Iterator[None]:
    """Within it whatever rosbags stumbles over is an UnreadableBodyError: a damaged bag fails in many ways."""
    try:
        yield
    except UnreadableBodyError:
        raise
    except Exception as error:
        said = str(error) or type(error).__name__
        raise unreadable(f"{said[:300]}. Copy it again, or repair it (ROS 1: rosbag reindex)") from None

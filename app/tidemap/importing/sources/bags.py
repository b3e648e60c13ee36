"""Bags: the topics of a ROS 1 or ROS 2 bag that say something of cells."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

import numpy as np

from tidemap.formats.ros_messages import SensorPoints, finite_points, laser_points, occupancy_states, stamp
from tidemap.formats.rosbag import POSES, SUFFIXES, Bag, BagMessage, BagTopic, unreadable
from tidemap.importing.options import ImportOptions
from tidemap.importing.records import Missing, Record, StateReadings, WholeMap, states
from tidemap.space.sweep import Sweep
from tidemap.space.transforms import MissingTransformError, TransformTree

Points = Callable[[Any, float], SensorPoints]
SENSORS: dict[str, Points] = {
    "sensor_msgs/msg/LaserScan": laser_points,
    "sensor_msgs/msg/PointCloud2": finite_points,
}
MAP = "nav_msgs/msg/OccupancyGrid"
STATES = {"std_msgs/msg/Bool", "std_msgs/msg/String"}
TYPES = {*SENSORS, MAP, *STATES}


def is_bag(path: Path) -> bool:
    """Whether a file or folder is a bag, by its name or by what is in it."""
    return path.suffix.lower() in SUFFIXES if path.is_file() else (path / "metadata.yaml").is_file()


@dataclass(frozen=True)
class BagSource:
    """One topic of a bag; `transforms` are read when somebody wants them."""

    path: Path
    options: ImportOptions
    topic: BagTopic
    transforms: Callable[[], TransformTree]

    @property
    def what(self) -> str:
        """The topic and its type."""
        return f"{self.topic.name} ({self.topic.type})"

    @property
    def kind(self) -> Literal["state", "grid"]:
        """What locations it is for."""
        return "state" if self.topic.type in STATES else "grid"

    def records(self) -> Iterator[Record]:
        """A record a message. Raises UnreadableBodyError."""
        tree = self.transforms() if self.topic.type in SENSORS else TransformTree()
        with Bag(self.path) as bag:
            for message in bag.messages({self.topic.name}):
                try:
                    yield self._record(message, tree)
                except ValueError as error:
                    raise unreadable(f"a message of {self.topic.name} is wrong: {error}") from None

    def _record(self, message: BagMessage, tree: TransformTree) -> Record:
        if self.topic.type in STATES:
            return self._reading(message)
        time = stamp(message.content.header) or message.recorded
        if self.topic.type == MAP:
            return self._map(message.content, time)
        found = SENSORS[self.topic.type](message.content, self.options.max_range_m)
        try:
            pose = tree.lookup(self.options.fixed_frame, message.content.header.frame_id, time)
        except MissingTransformError as error:
            return Missing(time, f"{error}. Name another --fixed-frame, or a --pose-topic")
        return Sweep(time, pose, found.points, found.max_range_m, found.flat)

    def _reading(self, message: BagMessage) -> StateReadings:
        data = message.content.data
        state = int(data) if isinstance(data, bool | np.bool_) else self.options.state_of(data)
        return StateReadings(np.array([message.recorded]), states([state]))

    def _map(self, message: Any, time: float) -> Record:
        grid, state = occupancy_states(message)
        if grid.frame != self.options.fixed_frame.lstrip("/"):
            return Missing(time, f"the map is in the frame {grid.frame!r}; name it with --fixed-frame")
        return WholeMap(time, grid, state)


def open_bag(path: Path, options: ImportOptions) -> list[BagSource]:
    """The topics of a bag that can be imported, or those of them that the options name. Raises UnreadableBodyError."""
    if find_spec("rosbags") is None:
        raise unreadable("the package rosbags is not installed. Run: pip install 'tidemap[import]'")
    with Bag(path) as bag:
        topics = dict(bag.topics)
    listed = ", ".join(f"{each.name} ({each.type})" for each in topics.values()) or "none"
    for name in {*options.topics, *options.pose_topics} - topics.keys():
        raise unreadable(f"it has no topic {name!r}. Its topics are {listed[:2000]}")
    for name in options.pose_topics:
        if topics[name].type not in POSES:
            raise unreadable(f"{name} is {topics[name].type}; poses come from one of {', '.join(sorted(POSES))}")
    chosen = [each for each in topics.values() if each.name in options.topics or not options.topics]
    found = [each for each in chosen if each.type in TYPES]
    if not found or (options.topics and len(found) < len(chosen)):
        raise unreadable(
            f"it has no topic to import, of one of {', '.join(sorted(TYPES))}. Its topics are {listed[:2000]}"
        )
    transforms = cache(partial(_transforms, path, options))
    return [BagSource(path, options, each, transforms) for each in found]


def _transforms(path: Path, options: ImportOptions) -> TransformTree:
    with Bag(path) as bag:
        return bag.transforms(options.pose_topics, options.robot_frame)

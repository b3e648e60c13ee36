"""Logs of CARMEN."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from tidemap.formats import carmen
from tidemap.importing.files import opened
from tidemap.importing.options import ImportOptions
from tidemap.importing.records import Record
from tidemap.space.pose import Pose
from tidemap.space.ranges import RangeLimits, points_of_ranges
from tidemap.space.sweep import Sweep

SUFFIXES = {".log", ".clf", ".carmen"}


@dataclass(frozen=True)
class Log:
    """The laser of a CARMEN log, at the poses that the log has for it."""

    path: Path
    options: ImportOptions
    what: str = "CARMEN log"
    kind: Literal["grid"] = "grid"

    def records(self) -> Iterator[Record]:
        """A sweep a line. Raises UnreadableBodyError."""
        with opened(self.path) as file:
            for line in carmen.read(file):
                yield self._sweep(line)

    def _sweep(self, line: carmen.LaserLine) -> Sweep:
        x, y, theta = line.pose
        rotation = (0.0, 0.0, math.sin(theta / 2), math.cos(theta / 2))
        high = self.options.max_range_m
        points = points_of_ranges(line.ranges, line.angle, RangeLimits(clear=high))
        return Sweep(
            line.time + self.options.start, Pose.of_quaternion(np.array([x, y, 0.0]), rotation), points, high, True
        )

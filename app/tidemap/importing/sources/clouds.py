"""Clouds: a folder of PCD and PLY files with a table of the poses they were taken at."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from tidemap.errors import UnreadableBodyError
from tidemap.formats import csv, pcd, ply
from tidemap.importing.files import content_of, naming, suffix_of
from tidemap.importing.options import ImportOptions
from tidemap.importing.records import Missing, Record
from tidemap.space.pose import Pose
from tidemap.space.ranges import measured
from tidemap.space.sweep import Sweep

READERS = {".pcd": pcd.read, ".ply": ply.read}
TABLE = "poses.csv"
NUMBERS = ("x", "y", "z", "qx", "qy", "qz", "qw")


@dataclass(frozen=True)
class CloudFolder:
    """The clouds of a folder: `poses.csv` in it has the columns file, time, x, y, z, qx, qy, qz and qw."""

    path: Path
    options: ImportOptions
    what: str = "folder of clouds"
    kind: Literal["grid"] = "grid"

    def records(self) -> Iterator[Record]:
        """A sweep a file that the table names, in its order; files that it does not name are missing a pose."""
        table = self.options.poses or self.path / TABLE
        if not table.is_file():
            raise UnreadableBodyError(
                f"There is no {table}. Write one with the columns file, time, {', '.join(NUMBERS)}, or name it with "
                "--poses."
            )
        with naming(table):
            poses = _poses(content_of(table))
        files = {each.name: each for each in clouds_of(self.path)}
        if absent := [name for name in poses if name not in files]:
            raise UnreadableBodyError(f"The poses are for {absent[0][:100]!r}, which is no cloud of this folder.")
        for name, (time, map_from_sensor) in poses.items():
            yield self._sweep(files[name], time + self.options.start, map_from_sensor)
        for name in sorted(files.keys() - poses.keys()):
            yield Missing(self.options.start, f"{name} has no row in {table.name}; add its pose")

    def _sweep(self, file: Path, time: float, map_from_sensor: Pose) -> Sweep:
        with naming(file):
            points = measured(READERS[suffix_of(file)](content_of(file)).astype(np.float64))
        return Sweep(time, map_from_sensor, points, self.options.max_range_m, flat=False)


def clouds_of(folder: Path) -> list[Path]:
    """The clouds of a folder, in order of their names."""
    return sorted(each for each in folder.iterdir() if suffix_of(each) in READERS)


def _poses(content: bytes) -> Mapping[str, tuple[float, Pose]]:
    """Time and pose by the name of the file. Raises UnreadableBodyError."""
    columns = csv.read(content, ["file", "time", *NUMBERS])
    times = csv.times(columns["time"])
    rows = np.stack([csv.numbers(name, columns[name]) for name in NUMBERS], axis=1)
    found = {}
    for name, time, row in zip(columns["file"], times.tolist(), rows, strict=True):
        try:
            found[name] = (time, Pose.of(row))
        except ValueError as error:
            raise csv.unreadable(f"the pose of {name[:100]!r}: {error}") from None
    if len(found) != len(rows):
        raise csv.unreadable("it names a file twice; leave one row out")
    return found

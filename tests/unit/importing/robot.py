"""A robot that drives along a corridor, as arrays and as a bag."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.support.bags import START, BagWriter, bag, turned
from tidemap.importing.opening import open_files
from tidemap.importing.options import ImportOptions
from tidemap.importing.records import Missing
from tidemap.importing.snapshots import SnapshotColumns, snapshot_of
from tidemap.space.grid import SINGLE, GridGeometry
from tidemap.space.rays import SeenCells, cast_rays

Array = NDArray[np.float64]
FLAT = GridGeometry("map", (-6.0, -5.0, 0.0), 0.25, (60, 40))
ROOM = GridGeometry("map", (-6.0, -5.0, -1.0), 0.25, (60, 40, 12))
MOUNT, MOUNT_YAW, YAW = np.array([0.25, 0.0, 0.5]), 0.75, -0.5
SCANS = (START + 0.5, START + 2.25, START + 3.0)
FIRST, STEP, N = -1.5, 0.05, 60
OPEN = {START + 1.0: True, START + 2.0: False, START + 7.0: True}
GRID_DATA = np.array([[0, 25, 26, 64], [65, 100, -1, 0], [50, 0, 100, 100]], np.int8)


def robot_at(time: float) -> Array:
    """Where the robot is, half a metre further every second."""
    return np.array([0.5 * (time - START), 1.0, 0.0])


def turn(yaw: float) -> Array:
    return np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])


def ranges(number: int) -> NDArray[np.float32]:
    """Some are NaN, infinite, beyond the highest range, and below the lowest."""
    found = np.random.default_rng(number).uniform(0.5, 6, N).astype(np.float32)
    found[[3, 4, 5, 6]] = np.nan, np.inf, 11, 0.05
    return found


def cloud(number: int) -> NDArray[np.float32]:
    found = np.random.default_rng(100 + number).uniform(-3, 3, (200, 3)).astype(np.float32)
    found[7] = np.nan
    return found


def seen_by_laser(grid: GridGeometry, number: int, max_range_m: float = 10.0) -> SeenCells:
    """The cells of one scan, from the arrays alone."""
    values, angle = ranges(number).astype(np.float64), FIRST + STEP * np.arange(N)
    kept = (values >= np.float32(0.1)) & ((values <= 10) | np.isposinf(values))
    values = np.minimum(values, 20.0)[kept]
    points = np.stack([values * np.cos(angle[kept]), values * np.sin(angle[kept]), 0 * values], axis=1)
    return _cast(grid, SCANS[number], points, max_range_m)


def seen_by_cloud(grid: GridGeometry, number: int) -> SeenCells:
    points = cloud(number).astype(np.float64)
    return _cast(grid, SCANS[number], points[~np.isnan(points).any(axis=1)], np.inf)


def _cast(grid: GridGeometry, time: float, points: Array, max_range_m: float) -> SeenCells:
    at = robot_at(time) + turn(YAW) @ MOUNT
    return cast_rays(grid, at, points @ turn(YAW + MOUNT_YAW).T + at, max_range_m=max_range_m)


def write(writer: BagWriter, transforms: bool = True, until: float = 4.0) -> None:
    """All that the robot recorded."""
    if transforms:
        writer.transform(START, "base_link", "sensor", MOUNT, turned(MOUNT_YAW), "/tf_static")
    for second in np.arange(0, until + 1):
        time = START + second
        if transforms:
            writer.transform(time, "map", "base_link", robot_at(time), turned(YAW))
        writer.odometry(time, "odom", "base_link", robot_at(time), turned(YAW))
    for number, time in enumerate(SCANS):
        writer.laser(time, "sensor", ranges(number), FIRST, STEP)
        writer.cloud(time, "sensor", cloud(number))
    for time, is_open in OPEN.items():
        writer.door(time, is_open)
    writer.occupancy(START + 5.0, "map", GRID_DATA, 0.25, np.array([1.0, 2.0, 0.0]), turned(0.0))


def written(folder: Path, kind: str, **how: Any) -> Path:
    with bag(folder, kind) as (path, writer):
        write(writer, **how)
    return path


def snapshots(path: Path, grid: GridGeometry | None = None, **options: Any) -> Iterator[SnapshotColumns]:
    """What of a file would be posted to a location with this grid."""
    chosen = ImportOptions(**options)
    for source in open_files([path], chosen):
        for record in source.records():
            assert not isinstance(record, Missing), record
            yield snapshot_of(record, grid or SINGLE, chosen.min_hits)

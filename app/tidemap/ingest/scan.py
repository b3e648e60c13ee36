"""Posted scans: what was sent to a `Scan`, refusing by name what cannot be one."""

from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import InvalidInputError
from tidemap.schemas.scans import ScanHeader
from tidemap.space.grid import GridGeometry
from tidemap.space.pose import Array, Pose
from tidemap.space.ranges import RangeLimits, measured, points_of_ranges
from tidemap.space.scan import Scan

MAX_ASYMMETRY = 1e-6
"""How much an entry of a covariance may differ from its mirror image, relative to the largest."""


@dataclass(frozen=True, slots=True, eq=False)
class SentScan:
    """A scan as it was sent: points (n, 2 or 3), or ranges (n,) whose angles are in the header."""

    header: ScanHeader
    points: NDArray[np.floating] | None = None
    ranges: NDArray[np.floating] | None = None


def scan_of(sent: SentScan, grid: GridGeometry) -> Scan:
    """What was sent, in the terms of the core. Raises InvalidInputError naming the first field that is wrong."""
    header = sent.header
    if header.frame not in (None, grid.frame):
        raise InvalidInputError.at(
            "frame",
            f"the grid is in frame {grid.frame!r}, not {header.frame!r}; send the transform into {grid.frame!r}",
        )
    points, flat = _points(sent)
    return Scan(
        points=points,
        map_from_sensor=_pose(header.map_from_sensor),
        covariance=None if header.covariance is None else _covariance(header.covariance),
        max_range_m=_max_range(header),
        min_hits=header.min_hits,
        flat=flat,
    )


def refuse_outside(scan: Scan, grid: GridGeometry) -> None:
    """Raise InvalidInputError for a scan whose sensor and points are all outside of the grid, and no ray crosses it."""
    ends = scan.map_from_sensor.apply(scan.points)
    looked_at = np.concatenate([scan.map_from_sensor.translation[np.newaxis], ends])
    cell = np.floor((looked_at - np.array(grid.origin)) / grid.resolution_m)
    used = 2 if grid.shape3[2] == 1 else 3
    inside = (cell[:, :used] >= 0) & (cell[:, :used] < grid.shape3[:used])
    if inside.all(axis=1).any() or len(scan.cast(grid).cell):
        return
    low, high = grid.origin, np.array(grid.origin) + np.array(grid.shape3) * grid.resolution_m
    raise InvalidInputError.at(
        "map_from_sensor",
        f"the sensor and all of its points are outside of the grid, which spans {list(low)} to {high.tolist()} m "
        f"in frame {grid.frame!r}, and no ray crosses it; check the pose, its direction (map from sensor) and that "
        "lengths are metres",
    )


def _pose(values: Any) -> Pose:
    try:
        return Pose.of(values)
    except ValueError as error:
        raise InvalidInputError.at("map_from_sensor", str(error)) from None


def _covariance(values: Any) -> Array:
    """A covariance (6, 6): symmetric, and no direction has less than no variance."""
    try:
        matrix = np.array(values, np.float64)
    except ValueError:
        matrix = np.zeros(0)
    if matrix.shape != (6, 6):
        raise InvalidInputError.at("covariance", "send six rows of six numbers")
    largest = float(np.abs(matrix).max())
    if largest == 0:
        raise InvalidInputError.at("covariance", "it is all zeros, which stands for unknown; leave it out then")
    if np.abs(matrix - matrix.T).max() > MAX_ASYMMETRY * largest:
        raise InvalidInputError.at("covariance", "it is not symmetric; send the covariance of x, y, z and rotations")
    matrix = (matrix + matrix.T) / 2
    if np.linalg.eigvalsh(matrix)[0] < -MAX_ASYMMETRY * largest:
        raise InvalidInputError.at("covariance", "it has a negative eigenvalue, which no covariance has")
    return matrix


def _max_range(header: ScanHeader) -> float:
    """Up to where rays clear: as it was said, and no further than the laser measures."""
    return min(inf if each is None else each for each in (header.max_range, header.range_max))


def _points(sent: SentScan) -> tuple[NDArray[np.float32], bool]:
    """Points (n, 3) float32, all finite and away from the sensor, and whether they are flat."""
    found = _measured(sent)
    points = np.zeros((len(found), 3), np.float32)
    with np.errstate(over="ignore"):  # what float32 cannot hold becomes infinite, and has no direction any more
        points[:, : found.shape[1]] = found
    points = measured(points)
    if not len(points):
        if sent.ranges is None:
            says = "there is none in it but NaN, infinity, or the sensor itself (0, 0, 0); leave such scans out"
            raise InvalidInputError.at("points", says)
        says = "none of them was measured: they are NaN, 0, or outside of range_min and range_max; leave such scans out"
        raise InvalidInputError.at("ranges", says)
    return points, sent.ranges is not None or found.shape[1] == 2


def _measured(sent: SentScan) -> NDArray[np.floating]:
    """Points (n, 2 or 3) as they were sent, or of ranges."""
    if sent.ranges is not None:
        return _of_ranges(sent.ranges, sent.header)
    if sent.points is None:
        raise InvalidInputError.at("ranges", "this field is missing")
    _refuse_angles(sent.header)
    return sent.points


def _refuse_angles(header: ScanHeader) -> None:
    for name in ("angles", "angle_min", "angle_increment", "range_min", "range_max"):
        if getattr(header, name) is not None:
            raise InvalidInputError.at(name, "this goes with ranges; with points leave it out")


def _of_ranges(ranges: NDArray[np.floating], header: ScanHeader) -> NDArray[np.float64]:
    """Points (n, 3) of ranges."""
    angles = _angles(len(ranges), header)
    clear = _max_range(header)
    if clear == inf and (ranges == inf).any():
        raise InvalidInputError.at("max_range", "ranges are infinite; send max_range, up to which their rays clear")
    limits = RangeLimits(header.range_min or 0.0, inf if header.range_max is None else header.range_max, clear)
    if limits.low > limits.high:
        raise InvalidInputError.at("range_min", f"it is above range_max, {limits.high}; swap them")
    return points_of_ranges(ranges.astype(np.float64), angles, limits)


def _angles(n: int, header: ScanHeader) -> NDArray[np.float64]:
    """The angles (n,) of rays. Raises InvalidInputError."""
    if header.angles is not None:
        if header.angle_min is not None or header.angle_increment is not None:
            raise InvalidInputError.at("angles", "send either angles, or angle_min and angle_increment")
        if len(header.angles) != n:
            raise InvalidInputError.at("angles", f"these are {len(header.angles)}, but {n} ranges; send one a range")
        return np.array(header.angles)
    if header.angle_min is None or header.angle_increment is None:
        raise InvalidInputError.at("angle_min", "ranges need angle_min and angle_increment, or angles")
    return np.asarray(header.angle_min + header.angle_increment * np.arange(n))

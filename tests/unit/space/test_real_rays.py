"""Rays of real scans: OctoMap's cells, and those of the slow truth."""

import gzip
import struct
from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.bench import sweep
from tests.support.octomap import octomap_states
from tests.support.slow_rays import rounded_path
from tests.unit.spectral.real import needed
from tidemap.space.grid import GridGeometry
from tidemap.space.pose import Pose
from tidemap.space.rays import SeenCells, cast_rays

Array = NDArray[np.float64]


def around(points: Array, resolution: float) -> GridGeometry:
    """A grid around points whose faces are at multiples of the resolution."""
    low = np.floor(points.min(axis=0) / resolution) - 1
    shape = np.floor(points.max(axis=0) / resolution) + 2 - low
    x, y, z = (low * resolution).tolist()
    return GridGeometry("map", (x, y, z), resolution, tuple(shape.astype(int).tolist()))


def as_single(points: Array) -> Array:
    """The nearest numbers that OctoMap, which counts in single precision, can tell apart."""
    return points.astype(np.float32).astype(np.float64)


def agreement(grid: GridGeometry, origin: Array, points: Array, max_range_m: float) -> tuple[bool, float]:
    """Whether the occupied cells are OctoMap's, and the share of free ones of either that both have."""
    octomap = octomap_states(grid, origin, points, max_range_m)
    ours = np.full(grid.n_cells, -1)
    seen = cast_rays(grid, origin, points, max_range_m=max_range_m)
    ours[seen.cell] = seen.state
    free, theirs = ours == 0, octomap == 0
    assert theirs.any()
    return np.array_equal(ours == 1, octomap == 1), float((free & theirs).sum() / (free | theirs).sum())


def spherical_scan() -> tuple[Array, Array]:
    """The sensor's position (3,) and the points (n, 3) of OctoMap's own scan graph."""
    content = needed("octomap", "spherical_scan.graph").read_bytes()
    (n,) = struct.unpack_from("<I", content, 4)
    rows = np.frombuffer(content, np.dtype([("size", "<u4"), ("at", "<f8", 3)]), n, 8)
    pose = np.frombuffer(
        content, np.dtype([("n", "<u4"), ("at", "<f8", 3), ("m", "<u4"), ("q", "<f8", 4)]), 1, 8 + 28 * n
    )
    w, x, y, z = pose["q"][0].tolist()
    map_from_sensor = Pose.of_quaternion(pose["at"][0], (x, y, z, w))
    return map_from_sensor.translation, map_from_sensor.apply(rows["at"])


@pytest.mark.parametrize("max_range_m", [-1.0, 2.5])
def test_the_scan_of_octomap_gives_its_cells(max_range_m: float) -> None:
    origin, points = (as_single(each) for each in spherical_scan())
    grid = around(np.vstack([points, origin]), 0.05)
    same_hits, shared = agreement(grid, origin, points, max_range_m if max_range_m > 0 else 1e6)
    assert same_hits
    assert shared >= 0.999


@pytest.mark.parametrize("max_range_m", [1e6, 5.0])
def test_a_simulated_sweep_gives_the_cells_of_octomap(max_range_m: float) -> None:
    same_hits, shared = agreement(sweep.GRID, as_single(sweep.ORIGIN), as_single(sweep.points()), max_range_m)
    assert same_hits
    assert shared >= 0.999


def lidar_cloud() -> Array:
    """(n, 3) points of a real sweep, the sensor at the origin."""
    content = needed("lidar_pair", "source.ply").read_bytes()
    rows = np.frombuffer(content[content.index(b"end_header\n") + 11 :], "<f4").reshape(-1, 4)
    return rows[:, :3].astype(np.float64)


@pytest.mark.parametrize("max_range_m", [1e6, 8.0])
def test_a_real_sweep_gives_the_cells_of_octomap(max_range_m: float) -> None:
    points, origin = lidar_cloud(), as_single(np.array([0.011, 0.012, 0.013]))
    points = points[(np.abs(points) < 20).all(axis=1)]
    same_hits, shared = agreement(around(points, 0.2), origin, points, max_range_m)
    assert same_hits
    assert shared >= 0.999


def laser_scans(name: str) -> Iterator[tuple[Array, Array]]:
    """Position (3,) and ends (n, 3) of the scans of a CARMEN log."""
    with gzip.open(needed("carmen2d", f"{name}-corrected.log.gz"), "rt") as file:
        lines = [line.split() for line in file if line.startswith("FLASER")]
    for fields in lines:
        n = int(fields[1])
        ranges, (x, y, theta) = np.array(fields[2 : 2 + n], float), map(float, fields[2 + n : 5 + n])
        angle = theta + np.linspace(-np.pi / 2, np.pi / 2, n)
        ends = np.stack([x + ranges * np.cos(angle), y + ranges * np.sin(angle), np.zeros(n)], axis=1)
        yield np.array([x, y, 0.0]), ends


def slow(grid: GridGeometry, origin: Array, ends: Array, max_range_m: float) -> tuple[set[int], set[int], set[int]]:
    """Linear cells hit, surely passed, and perhaps passed: those in which a ray is but for rounding."""
    hits, passed, perhaps = ([np.empty((0, 3), np.int64)] for _ in range(3))
    start = (origin - grid.origin) / grid.resolution_m + (0, 0, 0.5)
    for end in (ends - grid.origin) / grid.resolution_m + (0, 0, 0.5):
        length = round(float(np.linalg.norm(end - start)) * grid.resolution_m, 6)  # a log has whole centimetres
        stop = end if length <= max_range_m else start + (end - start) * (max_range_m / length)
        last = np.floor(stop).astype(int)
        sure, sliver = rounded_path(start, stop)
        passed.append(sure[(sure != last).any(axis=1)])
        perhaps.append(sliver)
        if length <= max_range_m:
            hits.append(last[np.newaxis])
    hit_cells, sure_cells, sliver_cells = (
        set(grid.cell(np.concatenate(each)).tolist()) for each in (hits, passed, perhaps)
    )
    return hit_cells, sure_cells, sliver_cells


@pytest.mark.parametrize("name", ["intel", "freiburg-101"])
def test_the_cells_of_a_laser_are_those_of_the_slow_truth(name: str) -> None:
    scans = list(laser_scans(name))
    assert len(scans) > 200
    reach = np.vstack([*(ends for _, ends in scans), *(origin for origin, _ in scans)])
    whole = around(reach, 0.1)
    grid = GridGeometry("map", (*whole.origin[:2], 0.0), 0.1, whole.shape[:2])
    for origin, ends in scans:
        seen: SeenCells = cast_rays(grid, origin, ends, max_range_m=20.0)
        occupied, free = (set(seen.cell[seen.state == state].tolist()) for state in (1, 0))
        hit, passed, perhaps = slow(grid, origin, ends, 20.0)
        assert occupied == hit
        assert passed - hit <= free <= (passed | perhaps) - hit

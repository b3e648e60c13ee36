"""Registration: scans with wrong poses are put right, and those that nothing holds are not believed."""

from functools import cache
from typing import Any

import numpy as np
import pytest
import small_gicp

from tests.support.paths import ROOT
from tests.support.rooms import CORRIDOR, LAB, VIEWS, Room, around, in_plane, level, off_by, sweep
from tests.support.scans import covariance
from tidemap.formats import ply
from tidemap.ingest.registration import RegistrationOutcome, register
from tidemap.space import alignment
from tidemap.space.alignment import Surface
from tidemap.space.centroids import surface_centroids
from tidemap.space.grid import GridGeometry
from tidemap.space.pose import Pose
from tidemap.space.scan import Scan

RESOLUTION_M = 0.1
STATED = covariance(0.04, 2.0)
PAIR = ROOT.parent / "shared" / "data" / "lidar_pair"


@cache
def known(room: Room, flat: bool, first: float = 0.0) -> Surface:
    """The cells of a room that exact scans hit, as a surface."""
    chance, points = np.random.default_rng(1), []
    for x, y in VIEWS if first == 0 else [(first + step, 1.1) for step in range(6)]:
        pose = level(x, y, 1.1, 0.0)
        directions = in_plane(4000) if flat else around(30_000, chance)
        points.append(pose.apply(sweep(room, pose, directions, chance, noise_m=0)))
    return surface(np.concatenate(points) * (1, 1, 0) if flat else np.concatenate(points), RESOLUTION_M, flat)


def surface(points: Any, resolution_m: float, flat: bool = False) -> Surface:
    """The surfaces of the cells that points (n, 3) are in."""
    low = np.floor(points.min(axis=0) / resolution_m).astype(int)
    index = np.unique(np.floor(points / resolution_m).astype(int) - low, axis=0)
    x, y, z = (low * resolution_m).tolist()
    grid = GridGeometry("map", (x, y, z), resolution_m, tuple((index.max(axis=0) + 1).tolist()))
    return Surface(surface_centroids(grid, grid.cell(index), np.ones(len(index))), np.zeros(3), resolution_m, flat)


def error(found: Pose, true: Pose) -> tuple[float, float]:
    """How far a pose is from the true one: metres and degrees."""
    rotation = Pose(found.rotation @ true.rotation.T, np.zeros(3)).rotation_vector
    return float(np.linalg.norm(found.translation - true.translation)), float(np.degrees(np.linalg.norm(rotation)))


def scans(number: int, flat: bool, seed: int) -> Any:
    """Scans of the lab with errors as stated, and the true pose of each."""
    chance = np.random.default_rng(seed)
    for i in range(number):
        true = level(*VIEWS[i % len(VIEWS)], 1.1, chance.uniform(-3, 3))
        points = sweep(LAB, true, in_plane(720) if flat else around(15_000, chance), chance)
        wrong = chance.normal(size=6) * np.sqrt(np.diag(STATED))
        if flat:
            wrong[2:5] = 0
        yield true, Scan(points, off_by(true, wrong), STATED, flat=flat)


@pytest.mark.parametrize("flat", [False, True], ids=["in space", "in the plane"])
def test_poses_are_put_right(flat: bool) -> None:
    for true, scan in scans(12, flat, seed=5):
        found = register(scan, known(LAB, flat))
        assert found.verdict == "accepted", found
        shift, rotation = error(found.map_from_sensor, true)
        assert shift < RESOLUTION_M * 0.7, "cells leave half of one open in each direction"
        assert rotation < 0.4
        if flat:
            assert found.map_from_sensor.translation[2] == scan.map_from_sensor.translation[2]


@pytest.mark.parametrize("flat", [False, True], ids=["in space", "in the plane"])
def test_a_door_that_opens_before_a_wall_draws_nothing_to_it(flat: bool) -> None:
    """Its leaf is near enough to the wall to be taken for it."""
    hall = Room(np.array([[0.05, 0.05, 0.05], [6.55, 1.35, 2.45]]), np.zeros((0, 2, 3)))
    changed = Room(hall.walls, np.array([[[0.2, 0.0, 0.0], [1.2, 0.25, 2.0]]]))
    chance, pose = np.random.default_rng(12), level(2.9, 0.8, 1.1, 0.3)
    directions = in_plane(720) if flat else around(15_000, chance)
    before = pose.apply(sweep(hall, pose, directions, chance))
    found = register(
        Scan(sweep(changed, pose, directions, chance), pose, STATED, flat=flat),
        surface(before * (1, 1, 0) if flat else before, RESOLUTION_M, flat),
    )
    assert found.verdict == "accepted"
    shift, rotation = error(found.map_from_sensor, pose)
    assert shift < 0.005
    assert rotation < 0.2, "taken for the wall it turns the scan by 0.6 degrees"


def test_the_correction_leads_from_the_stated_pose_to_the_one_that_stands() -> None:
    (_, scan), *_ = scans(1, False, seed=6)
    found = register(scan, known(LAB, False))
    assert found.correction is not None
    again = off_by(scan.map_from_sensor, found.correction)
    np.testing.assert_allclose(again.matrix, found.map_from_sensor.matrix, atol=1e-9)


def along_a_corridor(flat: bool, stated: Any) -> RegistrationOutcome:
    chance = np.random.default_rng(3)
    pose = level(0.0, 1.1, 1.1, 0.0)
    points = sweep(CORRIDOR, pose, in_plane(720) if flat else around(15_000, chance), chance)
    points = points[np.linalg.norm(points, axis=1) < 8]
    return register(Scan(points, pose, stated, max_range_m=8.0, flat=flat), known(CORRIDOR, flat, -3.0))


@pytest.mark.parametrize("flat", [False, True], ids=["in space", "in the plane"])
def test_nothing_holds_a_scan_along_a_bare_corridor(flat: bool) -> None:
    found = along_a_corridor(flat, covariance(0.2, 2.0))
    assert (found.verdict, found.correction is None) == ("quarantined", False)
    assert "slide" in found.reason
    assert along_a_corridor(flat, covariance(0.005, 0.05)).verdict == "raw_pose", "good to half a cell by itself"


def test_a_correction_that_the_covariance_does_not_allow_is_not_believed() -> None:
    lab = known(LAB, False)
    (true, scan), *_ = scans(1, False, seed=8)
    wrong = off_by(true, np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0]))
    found = register(Scan(scan.points, wrong, covariance(0.02, 0.5)), lab)
    assert found.verdict != "accepted"
    assert "covariance" in found.reason
    assert register(Scan(scan.points, wrong, covariance(0.2, 2.0)), lab).verdict == "accepted"


def test_an_alignment_in_rounds_comes_to_what_one_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """And none is so long that others wait for it."""
    lab, longest = known(LAB, False), []
    align = small_gicp.align

    def counted(*arguments: Any, max_iterations: int, **how: Any) -> Any:
        longest.append(max_iterations)
        return align(*arguments, max_iterations=max_iterations, **how)

    (_, scan), *_ = scans(1, False, seed=10)
    source = lab.source(scan.points, scan.map_from_sensor)
    shifts = np.random.default_rng(11).normal(size=(4, 6)) * 3 * np.sqrt(np.diag(STATED))
    monkeypatch.setattr(small_gicp, "align", counted)
    found = [lab.align(source, shift) for shift in shifts]
    assert max(longest) * alignment.ROUNDS == 20
    assert len(longest) > 3 * len(shifts), "some took a second round"
    monkeypatch.setattr(alignment, "ROUNDS", 1)
    monkeypatch.setattr(alignment, "ITERATIONS", 20)
    for rounds, one in zip(found, (lab.align(source, shift) for shift in shifts), strict=True):
        assert rounds.converged == one.converged
        np.testing.assert_allclose(rounds.map_from_sensor.matrix, one.map_from_sensor.matrix, atol=1e-6)


def test_with_nothing_to_hold_on_to_there_is_no_alignment() -> None:
    (_, scan), *_ = scans(1, False, seed=9)
    empty = Surface(np.zeros((3, 3)), np.zeros(3), RESOLUTION_M, False)
    assert register(scan, empty).features is None
    few = Scan(scan.points[:20], scan.map_from_sensor, STATED)
    assert "too few points" in register(few, known(LAB, False)).reason
    elsewhere = Scan(scan.points, level(300.0, 0.0, 1.0, 0.0), STATED)
    assert register(elsewhere, known(LAB, False)).verdict == "quarantined"


@pytest.mark.parametrize("resolution_m", [0.1, 0.2])
def test_real_sweeps_come_to_where_they_belong(resolution_m: float) -> None:
    if not PAIR.exists():
        pytest.skip("needs the real lidar pair in ../shared/data/lidar_pair")
    source, target = (ply.read((PAIR / f"{name}.ply").read_bytes()) for name in ("source", "target"))
    true = Pose.of_matrix(np.loadtxt(PAIR / "T_target_source.txt"))
    seen = surface(target.astype(np.float64), resolution_m)
    chance, good = np.random.default_rng(20), 0
    for _ in range(20):
        ways = chance.normal(size=(2, 3))
        ways *= (chance.uniform(0, [0.3, np.radians(5)]) / np.linalg.norm(ways, axis=1))[:, np.newaxis]
        found = register(Scan(source, off_by(true, ways.ravel()), covariance(0.2, 3.0)), seen)
        shift, rotation = error(found.map_from_sensor, true)
        good += found.verdict == "accepted" and shift < 0.02 and rotation < 0.2
    assert good >= 19

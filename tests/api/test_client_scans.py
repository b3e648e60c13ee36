"""Scans from a client to a real server process: at once, awaited, and through the outbox."""

import asyncio
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.messages import laser_scan, occupancy_grid, point_cloud
from tests.support.rooms import CORRIDOR, LAB, VIEWS, around, level, off_by, sweep
from tests.support.scans import covariance
from tests.support.server import ServerProcess
from tidemap import AsyncClient, Client
from tidemap.client import Queued, RetryPolicy, TidemapError
from tidemap.space.grid import GridGeometry
from tidemap.space.scan import Scan

GRID = {"origin": [-0.2, -0.2, -0.2], "resolution_m": 0.1, "shape": [84, 64, 32]}
GEOMETRY = GridGeometry("map", (-0.2, -0.2, -0.2), 0.1, (84, 64, 32))
START = 1_767_225_600.0
POSE = level(2.5, 3.2, 1.1, 0.4)
EAGER = RetryPolicy(first_s=0.05, max_s=0.2)


def seen(pose: Any, seed: int, n: int = 20_000, room: Any = LAB) -> Any:
    chance = np.random.default_rng(seed)
    return sweep(room, pose, around(n, chance), chance)


def test_a_robot_maps_a_lab_and_comes_back(shared_server: ServerProcess) -> None:
    with Client(shared_server.url) as tidemap:
        lab = tidemap.create_location("scanned-lab", kind="grid3d", interval_s=300, grid=GRID, estimator="static")
        for i in range(12):
            pose = level(*VIEWS[i % 6], 1.1, 0.5 * i)
            answer = lab.observe_scan(seen(pose, i), pose.matrix, START + 300 * i)
            assert answer.registration is not None
            assert answer.registration.verdict == "raw_pose"
        assert lab.update(wait=True).state == "done"
        wrong = off_by(POSE, np.array([0.08, -0.06, 0.05, 0.02, -0.02, 0.05]))
        stated: dict[str, Any] = {"covariance": covariance(0.04, 2.0), "max_range": 12.0}
        answer = lab.observe_scan(seen(POSE, 40), wrong.values, START + 7200, **stated)
        assert answer.registration is not None
        assert answer.registration.verdict == "accepted"
        corridor = seen(level(0, 1, 1.1, 0), 41, 3000, CORRIDOR)
        corridor = corridor[np.linalg.norm(corridor, axis=1) < 6]
        apart = lab.observe_scan(corridor, level(4, 3, 1.1, 0).values, START + 7500, **stated)
        (listed,) = lab.scans(registration="quarantined", limit=5)
        assert (listed.id, listed.registration) == (apart.scan, apart.registration)
        np.testing.assert_array_equal(lab.scan_points(listed.id), corridor)
        assert lab.replay_scan(listed.id).registration == apart.registration
        lab.delete_scan(listed.id)
        assert [each.id for each in lab.scans()] == [answer.scan, *range(answer.scan - 1, answer.scan - 13, -1)]  # type: ignore[operator]
        grid = lab.get().grid
        assert grid is not None
        hits = grid.cells(POSE.apply(seen(POSE, 40)))
        state = lab.state(START + 7200, confidence=0.5)
        assert (state.dense("state").ravel()[hits] == 1).mean() > 0.8
        band = state.to_occupancy_grid(z_min=0.3, z_max=1.5)
        assert (band.info.width, band.info.height) == (84, 64)
        assert band.data.reshape(64, 84)[34, 27] < 50, "the robot stood there"


def test_awaited_and_as_messages_of_ros(shared_server: ServerProcess) -> None:
    async def run() -> None:
        async with AsyncClient(shared_server.url) as tidemap:
            grid = {"resolution_m": 0.5, "shape": [20, 20]}
            floor = await tidemap.create_location("scanned-floor", kind="grid2d", interval_s=60, grid=grid)
            pose = [5.25, 5.25, 0.0, 0.0, 0.0, 0.0, 1.0]
            answer = await floor.observe_scan(laser_scan([2.0, np.inf, np.nan], angle_increment=np.pi / 2), pose)
            assert answer.accepted == 14, "four free and a hit, and nine up to the edge"
            assert answer.registration is not None
            cloud = await floor.observe_scan(point_cloud([[2.0, 0.0, 0.1]]), pose)
            assert cloud.accepted == 5
            percent = np.full((20, 20), -1)
            percent[3, 7] = 100
            message = occupancy_grid(percent)
            assert (await floor.observe_grid(message.header.stamp, grid=message)).accepted == 1
            await floor.update(wait=True, estimator="static")
            state = await floor.state(message.header.stamp)
            assert state.dense()[7, 3] > 0.5, "x is the first index here, and the second there"
            assert [each.id async for each in floor.scans()] == [cloud.scan, answer.scan]
            with pytest.raises(TidemapError, match="outside of the grid"):
                await floor.observe_scan(np.ones((3, 2)), [500.0, *pose[1:]], START)

    asyncio.run(run())


def test_what_is_scanned_out_of_range_arrives_once(shared_server: ServerProcess, tmp_path: Path) -> None:
    with Client(shared_server.url) as tidemap:
        lab = tidemap.create_location("scanned-later", kind="grid3d", interval_s=300, grid=GRID, estimator="static")
    points = seen(POSE, 50, 2000)
    with Client("http://127.0.0.1:9", outbox=tmp_path / "outbox.db", retry=EAGER) as spot:
        for i in range(3):
            receipt = spot.location("scanned-later").observe_scan(points, POSE.values, START + 300 * i)
            assert receipt == Queued(1, 2000)
        spot.location("scanned-later").observe_grid(START + 900, occupied=[0])
        assert spot.outbox.pending.batches == 4
    with Client(shared_server.url, outbox=tmp_path / "outbox.db", retry=EAGER) as spot:
        spot.outbox.flush(60)
        assert spot.outbox.refused() == []
    n_cells = len(Scan(points, POSE).cast(GEOMETRY).cell)
    with Client(shared_server.url) as tidemap:
        lab = tidemap.location("scanned-later")
        assert lab.get().observations == 3 * n_cells + 1
        assert [each.registration.verdict for each in lab.scans()] == ["raw_pose"] * 3

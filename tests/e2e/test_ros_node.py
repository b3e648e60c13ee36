"""The node of docs/examples/ros2, built by colcon and run by a real rclpy, beside a real server.

`make test` sets up what it needs, where there are wheels of ROS.
"""

import io
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.ros2.processes import PYTHON, RobotProcess, Workspace, node
from tests.support.server import StartServer
from tests.support.waiting import until
from tidemap import Client
from tidemap.client.outbox.store import OutboxStore
from tidemap.client.ros import Stamp
from tidemap.space.grid import GridGeometry
from tidemap.space.pose import Pose
from tidemap.space.rays import cast_rays

pytestmark = pytest.mark.skipif(not PYTHON.exists(), reason="no rclpy here: run 'make ros' where there are wheels")
GRID = {"origin": [-5.0, -5.0, 0.0], "resolution_m": 0.25, "shape": [40, 36]}
GEOMETRY = GridGeometry("map", (-5.0, -5.0, 0.0), 0.25, (40, 36))
POSE = [0.1, 0.2, 0.0, 0.0, 0.0, float(np.sin(0.15)), float(np.cos(0.15))]
POINTS = np.random.default_rng(7).uniform(-4, 4, (40, 3)).astype(np.float32)
FIRST, STEP, LOW, HIGH = -1.5, 0.05, 0.1, 6.0


def ranges(seed: int) -> np.ndarray[Any, Any]:
    """Some are NaN, infinite, beyond the highest range and below the lowest."""
    found = np.random.default_rng(seed).uniform(1, 4, 60).astype(np.float32)
    found[[3, 4, 5, 6]] = np.nan, np.inf, 7, 0.05
    return found


def cells_of(seed: int) -> list[int]:
    """The cells that a scan sees, from its arrays alone."""
    found, angle = ranges(seed).astype(np.float64), FIRST + STEP * np.arange(60)
    found[4] = 100.0
    kept = np.isfinite(found) & (found >= LOW) & ((found <= HIGH) | (found == 100.0))
    points = np.stack([found * np.cos(angle), found * np.sin(angle), 0 * found], axis=1)[kept]
    return cast(points, HIGH)


def cast(points: np.ndarray[Any, Any], max_range_m: float = np.inf) -> list[int]:
    """The cells that points in the sensor's frame are, and those before them."""
    pose = Pose.of(POSE)
    seen: list[int] = cast_rays(GEOMETRY, pose.translation, pose.apply(points), max_range_m=max_range_m).cell.tolist()
    return seen


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Workspace:
    return Workspace.built(tmp_path_factory.mktemp("workspace"))


@pytest.fixture
def robot(workspace: Workspace) -> Iterator[RobotProcess]:
    process = RobotProcess(workspace)
    yield process
    process.stop()


class Floor:
    """A location with a model, seen by a robot beside the node."""

    def __init__(self, tidemap: Client, robot: RobotProcess) -> None:
        self.lab = tidemap.create_location("lab", kind="grid2d", interval_s=60, grid=GRID, estimator="static")
        self.door = tidemap.create_location("door", interval_s=60)
        for hour in range(24, 0, -1):
            odd = hour % 2
            self.lab.observe_grid(time.time() - 3600 * hour, occupied=[0, 1 + odd], free=[2 - odd, 5, 6])
        self.lab.update()
        self.robot = robot
        self.observations = self.lab.get().observations

    def publish(self, seed: int, stamp: int, pose: list[float] | None = POSE) -> None:
        """Publish a laser scan."""
        said = {"angle_min": FIRST, "angle_increment": STEP, "range_min": LOW, "range_max": HIGH}
        self.robot.do("scan", stamp=[stamp, 0], ranges=ranges(seed).tolist(), pose=pose, **said)

    def scan(self, seed: int) -> None:
        """Publish until it is stored: a message may be lost, and the node takes one stamp once."""
        self._until_stored(partial(self.publish, seed), len(cells_of(seed)))

    def cloud(self) -> None:
        """The same of points."""

        def publish(stamp: int) -> None:
            self.robot.do("cloud", stamp=[stamp, 0], points=POINTS.tolist(), pose=POSE)

        self._until_stored(publish, len(cast(POINTS)))

    def _until_stored(self, publish: Callable[[int], None], n_cells: int) -> None:
        stamp, expected = int(time.time()), self.observations + n_cells

        def stored() -> bool:
            publish(stamp)
            self.observations = self.lab.get().observations
            return self.observations == expected

        until(stored)

    def map_since(self, time_s: float) -> dict[str, Any]:
        """A map that a new subscriber gets, of a later time."""

        def heard() -> dict[str, Any] | None:
            grid: dict[str, Any] = self.robot.do("map")
            return grid if grid["stamp"][0] > time_s else None

        return until(heard)


def test_a_scan_goes_in_and_the_predicted_map_comes_out(
    server: StartServer, workspace: Workspace, robot: RobotProcess, tmp_path: Path
) -> None:
    tidemap_server = server(env={"TIDEMAP_UPDATE_REST_S": "3600"})
    with Client(tidemap_server.url) as tidemap:
        admin = tidemap.keys.create("admin", "admin").key
    with Client(tidemap_server.url, admin) as tidemap:
        keys = {f"{role.upper()}_KEY": tidemap.keys.create(role, role).key for role in ("robot", "operator")}
        floor = Floor(tidemap, robot)
        outbox = tmp_path / "outbox.db"
        pace = {"scan_period_s": 0.5, "tf_wait_s": 600.0, "map_period_s": 1.0}
        exact = {"sigma_m": 0.0, "sigma_rad": 0.0}
        with node(
            workspace, tmp_path / "node.log", keys, url=tidemap_server.url, outbox=outbox, door="door", **pace, **exact
        ):
            until(lambda: dropped_as_ahead(floor, tmp_path / "node.log"))
            floor.scan(1)
            floor.cloud()
            file = floor.lab.export("npz", source="observed")
            with np.load(io.BytesIO(file.content)) as arrays:
                seen = np.flatnonzero(arrays["state"].ravel() >= 0).tolist()
            assert seen == sorted({0, 1, 2, 5, 6, *cells_of(1), *cast(POINTS)})
            robot.do("door", open=True)
            until(lambda: floor.door.get().observations == 1)
            heard = floor.map_since(time.time())
            check_predicted(heard, floor)
            answered = robot.do("get_map")
            assert (answered["data"], answered["shape"]) == (heard["data"], heard["shape"])

            tidemap_server.stop()
            keep(outbox, floor, 2)
            assert robot.do("get_map")["data"], "planners keep the map of before"
            tidemap_server.restart()
            expected = floor.observations + len(cells_of(2))
            until(lambda: floor.lab.get().observations == expected)


def dropped_as_ahead(floor: Floor, log: Path) -> bool:
    """Publish a scan of tomorrow, as from before a bag that is played began again; whether the node has given it up."""
    floor.publish(3, int(time.time()) + 86_400, pose=None)
    return "ahead of the clock" in log.read_text()


def keep(outbox: Path, floor: Floor, seed: int) -> None:
    """Publish a scan until it waits on the robot's disk."""
    store, stamp = OutboxStore(outbox, durable=True), int(time.time())

    def waits() -> bool:
        floor.publish(seed, stamp)
        return store.pending().batches == 1

    until(waits)
    store.close()


def check_predicted(heard: dict[str, Any], floor: Floor) -> None:
    """That a map is the one which the server predicts for its time."""
    predicted = floor.lab.state(Stamp(*heard["stamp"])).to_occupancy_grid(mode="trinary")
    assert heard["data"] == predicted.data.tolist()
    assert {-1, 0, 100} == set(heard["data"])
    assert (heard["frame"], heard["resolution"], heard["shape"]) == ("map", 0.25, [36, 40])
    assert heard["origin"] == [-5.0, -5.0, 0.0, 1.0]

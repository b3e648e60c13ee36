"""The page of a new location: what it shows to post with works as it is shown, of every kind."""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from types import SimpleNamespace as Shape
from typing import Any

import httpx
import numpy as np
import pytest
from playwright.sync_api import Page, expect

from tests.support.messages import occupancy_grid, point_cloud
from tests.support.server import ServerProcess
from tidemap import Client

WAIT_MS = 60_000
SHAPE = (6, 4, 2)


@pytest.fixture(scope="module")
def url(shared_server: ServerProcess) -> str:
    return shared_server.url


def make(page: Page, url: str, kind: str) -> None:
    """Fill in the form for a location that is called as its kind."""
    page.goto(f"{url}/new")
    page.get_by_label("Name").fill(kind)
    page.locator(f"input[value={kind}]").check()
    if kind != "state":
        for name, side in zip(("nx", "ny", "nz"), SHAPE, strict=True):
            page.locator(f"input[name={name}]").fill(str(side))
    page.get_by_role("button", name="Make it").click()
    expect(page.locator("#arrival")).to_contain_text("Waiting")
    expect(page.locator("#new-form")).to_be_hidden()


def shown(page: Page, label: str) -> str:
    """The lines of a kind that are shown, of which there is one."""
    (lines,) = page.locator(f"pre[aria-label='{label}']:visible").all()
    return lines.inner_text()


def measurements(url: str, name: str) -> int:
    number: int = httpx.get(f"{url}/api/v1/locations/{name}", trust_env=False).json()["observations"]
    return number


@pytest.mark.parametrize(("kind", "each"), [("state", 1), ("grid2d", 3), ("grid3d", 3)])
def test_the_lines_for_a_shell_python_and_ros_post_as_they_are_shown(
    url: str, page: Page, kind: str, each: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make(page, url, kind)
    environment = {**os.environ, "NO_PROXY": "*"}
    shell = ["sh", "-ec", shown(page, "Shell command")]
    done = subprocess.run(shell, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    expect(page.locator("#arrival")).to_have_text("The first post has arrived.", timeout=WAIT_MS)
    expect(page.locator("#arrival")).to_have_class("arrival arrived")
    assert measurements(url, kind) == each

    done = subprocess.run([sys.executable, "-c", shown(page, "Python program")], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert measurements(url, kind) == 2 * each

    monkeypatch.chdir(tmp_path)
    robot = Robot(monkeypatch)
    robot.run(shown(page, "Part of a ROS node"))
    robot.hear(MESSAGES[kind])
    assert measurements(url, kind) > 2 * each


MESSAGES: dict[str, Any] = {
    "state": Shape(data=True),
    "grid2d": occupancy_grid(np.where(np.arange(24).reshape(4, 6) % 2, 100, 0)),
    "grid3d": point_cloud(np.full((8, 3), 0.1, np.float32)),
}


class Robot:
    """What a node of ROS has, without ROS: its clock, its subscriptions, and transforms that are known."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.heard: list[Callable[[Any], object]] = []
        self.given: dict[str, Any] = {"node": self}
        names: dict[str, dict[str, Any]] = {
            "std_msgs.msg": {"Bool": object},
            "nav_msgs.msg": {"OccupancyGrid": object},
            "sensor_msgs.msg": {"PointCloud2": object},
            "rclpy.time": {"Time": Shape(from_msg=lambda stamp: stamp)},
            "tf2_ros": {"Buffer": Transforms, "TransformListener": lambda *_: None},
        }
        for name, values in names.items():
            module = ModuleType(name)
            vars(module).update(values)
            monkeypatch.setitem(sys.modules, name, module)
            monkeypatch.setitem(sys.modules, name.partition(".")[0], module)

    def run(self, lines: str) -> None:
        """Run a part of a node."""
        exec(lines, self.given)

    @property
    def tidemap(self) -> Client:
        """What the lines call so."""
        found: Client = self.given["tidemap"]
        return found

    def get_clock(self) -> Any:
        """A clock that is right."""
        return Shape(now=lambda: Shape(nanoseconds=time.time_ns()))

    def create_subscription(self, _kind: type, topic: str, hear: Callable[[Any], object], _depth: int) -> None:
        """Topics have names."""
        assert topic.startswith("/")
        self.heard.append(hear)

    def hear(self, message: Any) -> None:
        """A message comes; what is said of it has been sent, and taken, when this ends."""
        (hear,) = self.heard
        with self.tidemap as client:
            hear(message)
            assert client.outbox is not None
            assert client.outbox.flush(30.0)
            assert client.outbox.refused() == []


class Transforms:
    """A sensor in the middle of the first cell."""

    def lookup_transform(self, _target: str, _source: str, _time: Any) -> Any:
        """Shaped as geometry_msgs/TransformStamped."""
        at = Shape(translation=Shape(x=0.1, y=0.1, z=0.1), rotation=Shape(x=0.0, y=0.0, z=0.0, w=1.0))
        return Shape(transform=at)


def test_a_name_that_is_taken_is_said_on_the_form(url: str, page: Page) -> None:
    body = {"name": "taken", "interval_s": 60}
    assert httpx.post(f"{url}/api/v1/locations", json=body, trust_env=False).status_code == 201
    page.goto(f"{url}/new")
    page.get_by_label("Name").fill("taken")
    page.get_by_role("button", name="Make it").click()
    expect(page.get_by_role("alert").last).to_contain_text("taken")

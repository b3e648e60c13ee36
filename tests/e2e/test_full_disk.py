"""A disk that is full for a while: posts are refused, questions answered, and nothing is lost; then all goes on."""

import os
import resource
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.support.here import command
from tests.support.server import ServerProcess, StartServer
from tests.support.waiting import WAIT_S, until

ENV = {"TIDEMAP_VIEWER": "false", "TIDEMAP_UPDATER": "false", "TIDEMAP_UPDATER_INTERVAL_S": "0.1"}
LARGE = 40_000
"""Measurements of a post that needs some room."""
REFUSALS = 20


class Disk:
    """A place for data that can be full."""

    def __init__(
        self, folder: Path, fill: Callable[[ServerProcess], None], free: Callable[[ServerProcess], None]
    ) -> None:
        self.folder, self.fill, self.free = folder, fill, free


@pytest.fixture
def limited(tmp_path: Path) -> Disk:
    """No file of the server's may grow beyond its size: what every user may do to a process of their own."""
    if not sys.platform.startswith("linux"):
        pytest.skip("prlimit is Linux's")

    def limit(process: ServerProcess, most: int) -> None:
        hard = resource.prlimit(process.process.pid, resource.RLIMIT_FSIZE)[1]
        resource.prlimit(process.process.pid, resource.RLIMIT_FSIZE, (most, hard))

    def fill(process: ServerProcess) -> None:
        largest = max(path.stat().st_size for path in tmp_path.iterdir())
        limit(process, max(largest, process.log.stat().st_size + 100_000))

    return Disk(tmp_path, fill, lambda process: limit(process, resource.RLIM_INFINITY))


@pytest.fixture
def small(tmp_path: Path) -> Iterator[Disk]:
    """A file system of 16 MB, and a file in it that takes the rest of the room."""
    mount = ["mount", "-t", "tmpfs", "-o", "size=16m", "tmpfs", str(tmp_path)]
    done = (
        subprocess.run(mount, capture_output=True, text=True, check=False) if sys.platform.startswith("linux") else None
    )
    if done is None or done.returncode:
        pytest.skip("no file system can be mounted here: it needs Linux and its superuser")
    ballast = tmp_path / "ballast"

    def fill(_: ServerProcess) -> None:
        room = os.statvfs(tmp_path)
        with ballast.open("wb") as file:
            file.write(bytes(room.f_bavail * room.f_frsize))

    yield Disk(tmp_path, fill, lambda _: ballast.unlink())
    subprocess.run(["umount", "--lazy", str(tmp_path)], check=True)


@pytest.fixture(params=["limited", "small"])
def disk(request: pytest.FixtureRequest) -> Disk:
    """Both kinds."""
    made: Disk = request.getfixturevalue(request.param)
    return made


def post(http: httpx.Client, number: int) -> httpx.Response:
    form = {"time": [number * LARGE + n for n in range(LARGE)], "state": [n * number % 7 % 2 for n in range(LARGE)]}
    return http.post("/locations/door/observations", json=form, headers={"Idempotency-Key": f"k{number}"})


@contextmanager
def door(running: ServerProcess) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=f"{running.url}/api/v1", timeout=60, trust_env=False) as http:
        assert http.post("/locations", json={"name": "door", "interval_s": 1}).status_code == 201
        yield http


def ready(running: ServerProcess) -> tuple[int, Any]:
    answer = httpx.get(f"{running.url}/readyz", trust_env=False, timeout=WAIT_S)
    return answer.status_code, answer.json()["problems"]


def test_posts_are_refused_until_there_is_room_again(server: StartServer, disk: Disk) -> None:
    running = server("--data", str(disk.folder), env=ENV)
    with door(running) as http:
        stored = [n for n in range(3) if post(http, n).status_code == 201]
        assert stored == [0, 1, 2]
        disk.fill(running)
        number = len(stored)
        while (answer := post(http, number)).status_code == 201:
            stored.append(number)
            number += 1
            assert number < 2000, "it never became full"
        assert (answer.status_code, answer.json()["type"]) == (503, "urn:tidemap:problem:storage-unavailable")
        assert int(answer.headers["retry-after"]) >= 1
        for _ in range(REFUSALS):
            assert post(http, number).status_code == 503
        status, problems = ready(running)
        assert status == 503
        assert any("the database cannot be written" in problem for problem in problems), problems
        assert http.get("/locations/door").json()["observations"] == len(stored) * LARGE
        # Changes are logged, not every refusal; what is small may fit for a while where a post does not.
        assert 1 <= running.output().count("the database cannot be written") <= REFUSALS // 4
        assert command("verify", "--data", str(disk.folder)).returncode == 0

        disk.free(running)
        # By itself: a server that is not ready may get no posts.
        until(lambda: ready(running) == (200, []))
        for again in (number, number + 1, 0):
            assert post(http, again).status_code in (200, 201)
        assert http.get("/locations/door").json()["observations"] == (len(stored) + 2) * LARGE
        output = running.output()
        assert output.count("the database can be written again") == output.count("the database cannot be written")
        assert "Traceback" not in running.output()
    assert running.stop() == 0
    done = command("verify", "--data", str(disk.folder))
    assert done.returncode == 0, done.stdout
    assert f"{len(stored) + 2} observations: nothing wrong" in done.stdout

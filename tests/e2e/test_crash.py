"""Whatever ends the server, what it acknowledged is there, and what it did not can be sent again."""

import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import httpx
import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect as listen

from tests.support.server import ServerProcess, StartServer

ROBOTS = 4
PER_POST = 5
POSTS = 100_000
"""Posts that a robot has to send: more than it will."""
RESTLESS = {
    "TIDEMAP_VIEWER": "false",
    "TIDEMAP_UPDATER_INTERVAL_S": "0.05",
    "TIDEMAP_UPDATE_REST_S": "0",
    "TIDEMAP_UPDATE_GROWTH": "0.01",
}
"""A server that refits and compacts all the time, so that its end comes in the midst of that too."""


@dataclass
class Robot:
    """Posts one small observation after the other, each with its key, until it is told to stop."""

    number: int
    sent: int = 0
    acknowledged: list[int] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)

    def times(self, post: int) -> np.ndarray[Any, Any]:
        """No two posts have a time in common."""
        return ((post * ROBOTS + self.number) * PER_POST + np.arange(PER_POST)).astype(np.float64)

    def states(self, post: int) -> np.ndarray[Any, Any]:
        return np.random.default_rng([self.number, post]).integers(0, 2, PER_POST)

    def post(self, http: httpx.Client, number: int) -> httpx.Response:
        form = {"time": self.times(number).tolist(), "state": self.states(number).tolist()}
        headers = {"Idempotency-Key": f"robot-{self.number}-{number}"}
        return http.post("/locations/door/observations", json=form, headers=headers)

    def run(self, http: httpx.Client, stop: threading.Event) -> None:
        """Send until the server is gone, and try again when it is back."""
        while not stop.is_set() and self.sent < POSTS:
            try:
                answer = self.post(http, self.sent)
            except httpx.TransportError as error:
                self.failures.append(type(error).__name__)
                time.sleep(0.02)
                continue
            if answer.status_code in (200, 201):
                self.acknowledged.append(self.sent)
                self.sent += 1
            else:
                self.failures.append(str(answer.status_code))
                time.sleep(0.02)


@contextmanager
def robots_at_work(http: httpx.Client) -> Iterator[list[Robot]]:
    """Several robots posting; at the end each has stopped, perhaps in the midst of a post."""
    robots = [Robot(number) for number in range(ROBOTS)]
    stop = threading.Event()
    with ThreadPoolExecutor(ROBOTS) as pool:
        running: list[Future[None]] = [pool.submit(robot.run, http, stop) for robot in robots]
        try:
            yield robots
        finally:
            stop.set()
        for each in running:
            each.result()


def connect(server: ServerProcess) -> httpx.Client:
    return httpx.Client(base_url=f"{server.url}/api/v1", timeout=30, trust_env=False)


def until(condition: Callable[[], bool], seconds: float = 60) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "it did not come to that"
        time.sleep(0.01)


def acknowledged(robots: list[Robot]) -> int:
    return sum(len(robot.acknowledged) for robot in robots)


def check(http: httpx.Client, robots: list[Robot]) -> None:
    """Every acknowledged post is stored exactly once; the one in flight is, once it was sent again."""
    for robot in robots:
        assert robot.acknowledged == list(range(robot.sent))
        # The last one may or may not have been stored when its answer got lost.
        assert robot.post(http, robot.sent).status_code in (200, 201)
        again = robot.post(http, robot.sent)
        assert (again.status_code, again.json()["duplicate"]) == (200, True)
        for number in robot.acknowledged[:: max(1, len(robot.acknowledged) // 20)]:
            assert robot.post(http, number).json()["duplicate"] is True

    total = sum(robot.sent + 1 for robot in robots) * PER_POST
    assert http.get("/locations/door").json()["observations"] == total
    last = max(float(robot.times(robot.sent)[-1]) for robot in robots)
    expected: list[int | None] = [None] * (int(last) + 1)
    for robot in robots:
        for number in range(robot.sent + 1):
            for moment, state in zip(robot.times(number), robot.states(number), strict=True):
                expected[int(moment)] = int(state)
    answer = http.get("/locations/door/series", params={"start": 0, "stop": last + 1})
    assert answer.json()["observed"] == expected


def make_door(http: httpx.Client) -> None:
    form = {"name": "door", "interval_s": 1, "estimator": "static"}
    assert http.post("/locations", json=form).status_code == 201


def test_a_killed_server_has_lost_nothing_it_acknowledged(server: StartServer, database_url: str) -> None:
    running = server(database_url=database_url, env=RESTLESS)
    with connect(running) as http:
        make_door(http)
        with robots_at_work(http) as robots:
            for _ in range(1 if database_url.startswith("postgresql") else 2):
                before = acknowledged(robots)
                until(lambda before=before: acknowledged(robots) >= before + 150)  # type: ignore[misc]
                running.kill()
                running.restart()
                until(lambda: all(robot.failures for robot in robots))
                assert http.get("/locations/door").json()["observations"] >= before * PER_POST
            before = acknowledged(robots)
            until(lambda: acknowledged(robots) >= before + 50)
        assert all(set(robot.failures) <= {"ConnectError", "ReadError", "RemoteProtocolError"} for robot in robots)
        check(http, robots)
        # What was stored while dying can be refitted and compacted like everything else.
        job = http.post("/locations/door/update?wait=60", json={}).json()
        assert job["state"] == "done"
        check(http, robots)
    assert running.stop() == 0


def test_a_server_told_to_stop_finishes_what_it_took(server: StartServer) -> None:
    running = server(env=RESTLESS)
    with connect(running) as http:
        make_door(http)
        with robots_at_work(http) as robots:
            until(lambda: acknowledged(robots) >= 150)
            assert running.stop() == 0
            stopped = acknowledged(robots)
            until(lambda: all(robot.failures for robot in robots))
            assert acknowledged(robots) == stopped
            running.restart()
            until(lambda: acknowledged(robots) >= stopped + 50)
        kinds = {"ConnectError", "ReadError", "RemoteProtocolError", "503"}
        assert all(set(robot.failures) <= kinds for robot in robots), [robot.failures[:3] for robot in robots]
        check(http, robots)


def test_a_listener_does_not_keep_it_from_stopping(server: StartServer) -> None:
    running = server(env={"TIDEMAP_VIEWER": "false"})
    with listen(f"ws://127.0.0.1:{running.port}/api/v1/events") as socket:
        began = time.monotonic()
        assert running.stop() == 0
        assert time.monotonic() - began < 10
        with pytest.raises(ConnectionClosed) as closed:
            socket.recv(timeout=5)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code in (1001, 1012)

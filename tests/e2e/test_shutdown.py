"""Told to stop, the server answers every post that it is being sent, stores what it acknowledged, and takes no more.

Whatever it does beside them it leaves, and takes up again at the next start.
"""

import json
import shutil
import socket
import sqlite3
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from http.client import HTTPConnection
from pathlib import Path

import httpx
import numpy as np
import pytest
from sqlalchemy import create_engine

from tests.api.house import ARROW, arrow
from tests.support.databases import PostgresDatabases
from tests.support.postgres import Postgres
from tests.support.server import ServerProcess, StartServer
from tests.support.waiting import WAIT_S, until
from tidemap.services.verify import verify

CLIENTS = 24
PER_POST = 1000
QUIET = {"TIDEMAP_VIEWER": "false", "TIDEMAP_UPDATER": "false"}
MID_BODY = 0.5
"""The part of a body that has been sent when the server is told to stop."""


class HalfPost:
    """A post whose sender is in the midst of its body."""

    def __init__(self, server: ServerProcess, number: int) -> None:
        times = [float(number * PER_POST + i) for i in range(PER_POST)]
        body = json.dumps({"time": times, "state": [number % 2] * PER_POST}).encode()
        cut = int(len(body) * MID_BODY)
        head = (
            "POST /api/v1/locations/door/observations HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
            f"Idempotency-Key: {number}\r\nContent-Length: {len(body)}\r\n\r\n"
        )
        self._rest = body[cut:]
        self._socket = socket.create_connection(("127.0.0.1", server.port), timeout=WAIT_S)
        self._socket.sendall(head.encode() + body[:cut])

    def finish(self) -> bytes:
        """Send the rest; all that is answered."""
        self._socket.sendall(self._rest)
        return b"".join(self._read())

    def close(self) -> None:
        """Give up."""
        self._socket.close()

    def _read(self) -> Iterator[bytes]:
        while part := self._socket.recv(1 << 16):
            yield part


def until_it_takes_no_more(server: ServerProcess) -> None:
    deadline = time.monotonic() + 30
    while time.monotonic() < deadline:
        try:
            socket.create_connection(("127.0.0.1", server.port), timeout=WAIT_S).close()
        except ConnectionRefusedError:
            return
        time.sleep(0.01)
    raise AssertionError("it goes on listening")


def until_reading(server: ServerProcess) -> None:
    """Until the server has begun to read every half post: it answers what was sent after them."""
    with api(server) as http:
        assert http.get("/locations/door").status_code == 200


@pytest.fixture
def running(server: StartServer) -> ServerProcess:
    """A server with a door."""
    started = server(env=QUIET)
    with api(started) as http:
        assert http.post("/locations", json={"name": "door", "interval_s": 1}).status_code == 201
    return started


def api(server: ServerProcess) -> httpx.Client:
    return httpx.Client(base_url=f"{server.url}/api/v1", timeout=WAIT_S, trust_env=False)


def test_posts_that_are_being_sent_are_answered_and_stored(running: ServerProcess) -> None:
    with ExitStack() as stack:
        posts = [stack.enter_context(closing(HalfPost(running, number))) for number in range(CLIENTS)]
        until_reading(running)
        running.process.terminate()
        until_it_takes_no_more(running)
        answers = [post.finish() for post in posts]
    assert [answer.split(b"\r\n")[0] for answer in answers] == [b"HTTP/1.1 201 Created"] * CLIENTS
    assert all(b"connection: close" in answer.lower() for answer in answers)
    assert running.stop() == 0
    running.restart()
    with api(running) as http:
        assert http.get("/locations/door").json()["observations"] == CLIENTS * PER_POST


def test_a_sender_that_never_ends_does_not_keep_it_from_stopping(running: ServerProcess) -> None:
    with closing(HalfPost(running, 0)):
        until_reading(running)
        assert running.stop() == 0
    running.restart()
    with api(running) as http:
        assert http.get("/locations/door").json()["observations"] == 0


def test_waiting_for_a_job_ends_when_the_server_stops(running: ServerProcess) -> None:
    with api(running) as http:
        job = http.post("/locations/door/update", json={}).json()
    with closing(HTTPConnection("127.0.0.1", running.port, timeout=WAIT_S)) as waiting:
        waiting.request("GET", f"/api/v1/jobs/{job['id']}?wait=300")
        until_reading(running)
        assert running.stop() == 0
        answer = waiting.getresponse()
        assert (answer.status, json.load(answer)["id"]) == (200, job["id"])


WAITING = "SELECT count(*) FROM pg_stat_activity WHERE wait_event_type = 'Lock' AND datname = current_database()"


def test_a_database_that_hangs_does_not_keep_it_from_stopping(server: StartServer, postgres: Postgres) -> None:
    with PostgresDatabases(postgres).migrated() as url:
        hung = server(database_url=url, env={"TIDEMAP_VIEWER": "false", "TIDEMAP_MAX_STOP_S": "2"})
        engine = create_engine(url)
        with engine.begin() as connection, api(hung) as http, ThreadPoolExecutor() as pool:
            connection.exec_driver_sql("LOCK TABLE location")
            asked = pool.submit(http.post, "/locations", json={"name": "door", "interval_s": 1})
            # The writer with that, and one of those that work in the background at least.
            until(lambda: connection.exec_driver_sql(WAITING).scalar_one() >= 3)
            began = time.monotonic()
            assert hung.stop() == 1
            assert time.monotonic() - began < WAIT_S
            assert isinstance(asked.exception(), httpx.TransportError)
        engine.dispose()
    last = hung.output(1)
    assert "did not end within 2 s" in last
    assert all(name in last for name in ("writer", "compactor"))
    assert "Traceback" not in hung.output()


GRID = {"frame": "map", "origin": [0, 0, 0], "resolution_m": 0.1, "shape": [100, 100, 20]}
CELLS, LOOKS = 200_000, 30


@pytest.fixture(scope="module")
def filled(module_server: StartServer) -> Path:
    """A database with some seconds of compaction and many chunks of an update to do, and nothing of it done."""
    started = module_server(env=QUIET)
    cells = np.arange(CELLS, dtype=np.uint32)
    form = {"name": "lab", "kind": "grid3d", "interval_s": 60, "estimator": "fft", "order": 3, "grid": GRID}
    with api(started) as http:
        assert http.post("/locations", json=form).status_code == 201
        for look in range(LOOKS):
            state = ((cells // 7 + look) % 3 == 0).astype(np.uint8)
            body = arrow({"time": np.full(CELLS, 1.7e9 + 60.0 * look), "cell": cells, "state": state})
            headers = {"Content-Type": ARROW}
            assert http.post("/locations/lab/observations", content=body, headers=headers).status_code == 201
    assert started.stop() == 0
    return started.data / "tidemap.db"


@pytest.fixture
def path(filled: Path, tmp_path: Path) -> Path:
    """A copy of it."""
    return Path(shutil.copy(filled, tmp_path))


@pytest.fixture
def busy(server: StartServer, path: Path) -> ServerProcess:
    """A server on that."""
    return server(database_url=f"sqlite:///{path}", env=QUIET)


def updating(server: ServerProcess, progress: float) -> int:
    """Ask for an update and wait until it has come so far; the job's number."""
    with api(server) as http:
        number = http.post("/locations/lab/update", json={}).json()["id"]
        deadline = time.monotonic() + 60
        while (job := http.get(f"/jobs/{number}").json())["state"] != "running" or job["progress"] < progress:
            assert job["state"] in ("queued", "running"), job
            assert time.monotonic() < deadline, job
            time.sleep(0.005)
    return int(number)


@pytest.mark.parametrize(("progress", "compacted"), [(0.0, 0), (0.12, LOOKS)], ids=["compacting", "fitting"])
def test_an_update_is_left_and_runs_again_at_the_next_start(
    busy: ServerProcess, path: Path, progress: float, compacted: int
) -> None:
    number = updating(busy, progress)
    assert busy.stop() == 0
    with closing(sqlite3.connect(path)) as database:
        assert database.execute("SELECT compacted_seq, revision FROM location").fetchone() == (compacted, 0)
        assert database.execute("SELECT state FROM job WHERE id = ?", (number,)).fetchone() == ("running",)
    busy.restart()
    with api(busy) as http:
        deadline = time.monotonic() + 120
        while (job := http.get(f"/jobs/{number}").json())["state"] != "done":
            assert job["state"] in ("queued", "running"), job
            assert time.monotonic() < deadline, job
            time.sleep(0.05)
        location = http.get("/locations/lab").json()
    assert (location["observations"], location["revision"]) == (CELLS * LOOKS, job["result"]["revision"])
    assert busy.stop() == 0
    findings: list[object] = []
    verify(f"sqlite:///{path}", findings.append)
    assert findings == []
    assert "Traceback" not in busy.output()


def test_a_compaction_is_left_and_goes_on_at_the_next_start(path: Path, server: StartServer) -> None:
    def compacted() -> int:
        with closing(sqlite3.connect(path)) as database:
            return int(database.execute("SELECT compacted_seq FROM location").fetchone()[0])

    # It is compacted from the start on, and no update is due.
    running = server(
        database_url=f"sqlite:///{path}", env={"TIDEMAP_VIEWER": "false", "TIDEMAP_UPDATE_SAMPLES": "1000000"}
    )
    assert running.stop() == 0
    assert compacted() == 0
    running.restart()
    deadline = time.monotonic() + 120
    while compacted() < LOOKS:
        assert time.monotonic() < deadline
        time.sleep(0.05)
    assert running.stop() == 0
    findings: list[object] = []
    verify(f"sqlite:///{path}", findings.append)
    assert findings == []

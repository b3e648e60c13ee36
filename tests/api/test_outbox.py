"""The outbox with real servers and real robots, and both killed: what was observed is there exactly once."""

import asyncio
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from itertools import count
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from tests.support.server import ServerProcess, StartServer
from tests.support.waiting import until
from tidemap.client import AsyncClient, Client, OutboxFullError, Pending, Queued, RetryPolicy

OUT_OF_RANGE = "http://127.0.0.1:9"
GRID = (np.arange(24) % 3 - 1).reshape(4, 3, 2)
EAGER = RetryPolicy(first_s=0.05, max_s=0.2)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "outbox.db"


@pytest.fixture
def running(server: StartServer) -> ServerProcess:
    """A server of the test's own with a location `door`, sampled each second."""
    process = server(env={"TIDEMAP_VIEWER": "false"})
    make(process, "door")
    return process


@pytest.fixture
def name(request: pytest.FixtureRequest, shared_server: ServerProcess) -> str:
    """A location of this test's own at the shared server, sampled each second."""
    name = "".join(c if c.isalnum() else "-" for c in request.node.name)[:100]
    make(shared_server, name)
    return name


def make(process: ServerProcess, name: str) -> None:
    with Client(process.url) as tidemap:
        tidemap.create_location(name, interval_s=1, estimator="static")


def robot(url: str, path: Path, **how: Any) -> Client[Queued]:
    return Client(url, outbox=path, retry=EAGER, **how)


def stored(process: ServerProcess, name: str = "door") -> tuple[int, dict[int, int]]:
    """How many measurements the server has stored, repeats counted, and the state of every second it knows."""
    with Client(process.url) as tidemap:
        info = tidemap.location(name).get()
        if info.last_time is None or info.first_time is None:
            return 0, {}
        series = tidemap.location(name).series(start=info.first_time, stop=info.last_time + 1, step=1)
    seen = np.flatnonzero(series.observed >= 0)
    return info.observations, {int(series.time[i]): int(series.observed[i]) for i in seen}


def log_of(process: ServerProcess) -> dict[int, list[float]]:
    """The times of the posts to each location, in the order in which the server stored them."""
    posts: dict[int, list[float]] = {}
    with closing(sqlite3.connect(process.data / "tidemap.db")) as db:
        for location, time_s in db.execute("SELECT location_id, first_time FROM observation ORDER BY location_id, id"):
            posts.setdefault(location, []).append(time_s)
    return posts


def test_what_was_observed_out_of_range_arrives_once_and_in_order(running: ServerProcess, path: Path) -> None:
    make(running, "window")
    running.kill()
    for first in (80, 40):  # the robot is switched off and on in between
        with robot(running.url, path) as spot:
            for second in range(first, first - 40, -1):
                assert spot.location("door").observe([second], [second % 2]) == Queued(1, 1)
                assert spot.location("window").observe([second], [0]) == Queued(1, 1)
            assert not spot.outbox.flush(0.1)
            assert "unreachable" in str(spot.outbox.pending.last_error)
            held = spot.outbox.pending.batches
    assert held == 160
    with robot(running.url, path) as spot:
        running.restart()
        assert spot.outbox.flush(120)
        assert spot.outbox.pending == Pending(0, 0)
    assert stored(running) == (80, {second: second % 2 for second in range(1, 81)})
    assert list(log_of(running).values()) == [list(range(80, 0, -1))] * 2


@contextmanager
def deaf(process: ServerProcess, answers: int) -> Iterator[str]:
    """The URL of a network between robot and server that carries every post, but only so many answers in ten."""
    carried = count()

    class Network(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            content = self.rfile.read(int(self.headers["Content-Length"]))
            answer = httpx.post(process.url + self.path, content=content, headers=dict(self.headers), timeout=60)
            if next(carried) % 10 < answers:
                self.send_response(answer.status_code)
                self.end_headers()
                self.wfile.write(answer.content)

        def log_message(self, *_: object) -> None:
            pass

    network = ThreadingHTTPServer(("127.0.0.1", 0), Network)
    thread = threading.Thread(target=network.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    try:
        yield f"http://127.0.0.1:{network.server_port}"
    finally:
        network.shutdown()
        network.server_close()
        thread.join()


def test_answers_that_get_lost_store_nothing_twice(shared_server: ServerProcess, name: str, path: Path) -> None:
    with deaf(shared_server, 6) as url, robot(url, path) as spot:
        for second in range(20):
            spot.location(name).observe([second], [second % 2])
        assert spot.outbox.flush(60)
        assert spot.outbox.refused() == []
    assert stored(shared_server, name) == (20, {second: second % 2 for second in range(20)})


def test_refused_batches_are_put_aside_and_sent_when_they_can_be(
    shared_server: ServerProcess, name: str, path: Path
) -> None:
    with robot(shared_server.url, path) as spot:
        spot.location(name).observe([1], [1])
        spot.location(name).observe([2], [2])
        spot.location("attic").observe([3], [1])
        spot.location(name).observe([4], [0])
        assert spot.outbox.flush(60)
        wrong, unknown = spot.outbox.refused()
        assert (wrong.status, unknown.status) == (422, 404)
        assert "a state is 0 (free) or 1 (occupied)" in wrong.error
        assert "attic" in unknown.error
        make(shared_server, "attic")
        spot.outbox.retry(unknown.id)
        spot.outbox.discard(wrong.id)
        assert spot.outbox.flush(60)
        assert spot.outbox.refused() == []
    assert stored(shared_server, name) == (2, {1: 1, 4: 0})
    assert stored(shared_server, "attic") == (1, {3: 1})


FAR_AHEAD = 4e9


@pytest.mark.parametrize("arrow", [True, False])
def test_of_a_batch_with_wrong_readings_the_others_are_stored(
    shared_server: ServerProcess, name: str, path: Path, monkeypatch: pytest.MonkeyPatch, arrow: bool
) -> None:
    if not arrow:
        monkeypatch.setattr("tidemap.client.arrow.pa", None)
    times = [*range(20), FAR_AHEAD, FAR_AHEAD + 7]
    with robot(shared_server.url, path) as spot:
        spot.location(name).observe(times, [n % 2 for n in range(22)])
        assert spot.outbox.flush(60)
        refused = spot.outbox.refused()
        assert sum(each.measurements for each in refused) == 2
        assert {each.status for each in refused} == {422}
        assert all("future" in each.error for each in refused)
    assert stored(shared_server, name) == (20, {second: second % 2 for second in range(20)})


def test_of_observations_in_rows_the_good_ones_are_stored(shared_server: ServerProcess, path: Path) -> None:
    grid = {"resolution_m": 0.5, "shape": [4, 3, 2]}
    with robot(shared_server.url, path) as spot, Client(shared_server.url) as tidemap:
        yard = tidemap.create_location("yard", kind="grid3d", interval_s=60, grid=grid)
        cells = [[0, 0, 0], [1, 1, 1], [9, 9, 9], [2, 2, 1], [0, 1, 0]]
        spot.location("yard").observe([0, 60, 120, 180, 240], [1, 0, 1, 0, 1], cells)
        assert spot.outbox.flush(60)
        (refused,) = spot.outbox.refused()
        assert refused.measurements == 1
        assert yard.get().observations == 4


def test_a_key_that_is_not_valid_yet_costs_nothing_and_is_not_written_down(running: ServerProcess, path: Path) -> None:
    with Client(running.url) as owner, Client(running.url, key=owner.keys.create("root", "admin").key) as admin:
        with robot(running.url, path, key="tm_wrong") as spot:
            spot.location("door").observe([1], [1])
            assert "401" in str(until(lambda: spot.outbox.pending.last_error))
            assert spot.outbox.refused() == []
        key = admin.keys.create("spot", "robot").key
        with robot(running.url, path, key=key) as spot:
            assert spot.outbox.flush(60)
            assert not any(key.encode() in file.read_bytes() for file in path.parent.iterdir())
        assert admin.location("door").get().observations == 1


def test_a_limit_of_requests_delays_and_loses_nothing(
    server: StartServer, path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    limits = {"TIDEMAP_REQUESTS_PER_S": "1", "TIDEMAP_REQUESTS_BURST": "2"}
    process = server(env={"TIDEMAP_VIEWER": "false", **limits})
    make(process, "door")
    with Client(process.url) as owner:
        key = owner.keys.create("spot", "admin").key
    with robot(process.url, path, key=key) as spot:
        for second in range(6):
            spot.location("door").observe([second], [second % 2])
        assert spot.outbox.flush(60)
        assert spot.outbox.refused() == []
        assert "Too many requests" in caplog.text
    with Client(process.url, key=key) as owner:  # patient enough for a limit of one a second
        assert owner.location("door").get().observations == 6
    assert [time_s for posts in log_of(process).values() for time_s in posts] == list(range(6))


def test_cells_as_rows_are_queued_without_the_server(shared_server: ServerProcess, path: Path) -> None:
    cells = np.argwhere(np.ones((4, 3, 2)))
    states = np.arange(48) % 5 == 0
    with robot(OUT_OF_RANGE, path) as spot:
        spot.location("lab").observe(np.repeat([0, 60], 24), states, np.tile(cells, (2, 1)))
        spot.location("lab").observe_grid(120, occupied=cells[3:5], free=cells[20:])
        assert spot.location("lab").observe_grid(180, grid=GRID) == Queued(1, 16)
    with robot(shared_server.url, path) as spot, Client(shared_server.url) as tidemap:
        grid = {"resolution_m": 0.5, "shape": [4, 3, 2]}
        lab, twin = (tidemap.create_location(n, kind="grid3d", interval_s=60, grid=grid) for n in ("lab", "twin"))
        for refused in spot.outbox.refused():  # if it was quicker than we
            spot.outbox.retry(refused.id)
        assert spot.outbox.flush(60)
        twin.observe(np.repeat([0, 60], 24), states, np.tile(np.arange(24), 2))
        twin.observe_grid(120, occupied=[3, 4], free=[20, 21, 22, 23])
        twin.observe_grid(180, grid=GRID)
        assert [handle.update().state for handle in (lab, twin)] == ["done", "done"]
        for time_s in (0, 60, 120, 180):
            one, two = (handle.state(time_s, observed=True).dense("observed") for handle in (lab, twin))
            np.testing.assert_array_equal(one, two)


def test_a_full_outbox_keeps_nothing_of_what_does_not_fit(shared_server: ServerProcess, name: str, path: Path) -> None:
    def fill(spot: Client[Queued]) -> None:
        for second in range(1000):
            spot.location(name).observe([second], [1])

    with robot(OUT_OF_RANGE, path, outbox_bytes=20_000) as spot:
        with pytest.raises(OutboxFullError):
            fill(spot)
        kept = spot.outbox.pending
        assert kept.batches > 10
        assert 19_000 < kept.bytes <= 20_000
    with robot(shared_server.url, path, outbox_bytes=20_000) as spot:
        assert spot.outbox.flush(60)
        spot.location(name).observe([kept.batches], [0])
        assert spot.outbox.flush(60)
    assert stored(shared_server, name) == (
        kept.batches + 1,
        dict.fromkeys(range(kept.batches), 1) | {kept.batches: 0},
    )


def test_the_asynchronous_client_out_of_range(shared_server: ServerProcess, name: str, path: Path) -> None:
    async def observe(url: str, start: int) -> None:
        async with AsyncClient(url, outbox=path, retry=EAGER) as spot:
            for second in range(start, start + 30):
                assert await spot.location(name).observe([second], [second % 2]) == Queued(1, 1)

    async def finish() -> None:
        async with AsyncClient(shared_server.url, outbox=path, retry=EAGER) as spot:
            assert await spot.outbox.flush(60)

    asyncio.run(observe(OUT_OF_RANGE, 0))
    asyncio.run(observe(shared_server.url, 30))
    asyncio.run(finish())
    assert stored(shared_server, name) == (60, {second: second % 2 for second in range(60)})

"""What the outbox makes of the server's answers; the servers here are scripts."""

import asyncio
import json
import logging
import threading
import time
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from tests.support.waiting import WAIT_S, until
from tests.unit.client.scripted import Received, Said, Script, scripted
from tests.unit.client.test_retry import BUSY, HANG_UP, QUICK, STORED
from tidemap.client import AsyncClient, Client, OutboxError, OutboxFullError, Pending, Queued, RetryPolicy
from tidemap.client.outbox.backoff import ALL, Backoff
from tidemap.client.outbox.outcome import SendOutcome, judge
from tidemap.client.posting import observation, sighting

OK = Said(201, STORED)
AGAIN = Said(200, STORED | {"duplicate": True})
WRONG = Said(422, BUSY | {"status": 422, "errors": [{"field": "state[0]", "message": "a state is 0 or 1"}]})
SIGN_IN = Said(200, b"<html>Welcome to the airport's network</html>")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "outbox.db"


def client(script: Script, path: Path, retry: RetryPolicy = QUICK, **how: Any) -> Client[Queued]:
    return Client(script.url, retry=retry, outbox=path, **how)


def keys(received: list[Received]) -> list[str]:
    return [request.headers["Idempotency-Key"] for request in received]


def test_what_is_queued_is_sent_as_it_would_have_been(path: Path) -> None:
    with scripted(OK) as script, client(script, path, key="tm_k") as robot:
        door = robot.location("door")
        assert door.observe([0.0, 1.0], [1, 0], source="spot", idempotency_key="mine") == Queued(1, 2)
        assert door.observe_grid(5, occupied=[1, 2], free=[3]) == Queued(1, 3)
        assert robot.outbox.flush(WAIT_S)
        assert robot.outbox.pending == Pending(0, 0)
    with scripted(OK) as direct, Client(direct.url, key="tm_k") as other:
        other.location("door").observe([0.0, 1.0], [1, 0], source="spot", idempotency_key="mine")
        other.location("door").observe_grid(5, occupied=[1, 2], free=[3])
    for one, two in zip(script.received, direct.received, strict=True):
        assert (one.method, one.path, one.content) == (two.method, two.path, two.content)
        assert one.headers["Content-Type"] == two.headers["Content-Type"]
        assert one.headers["Authorization"] == "Bearer tm_k"
    assert keys(script.received)[0] == "mine"
    assert len(keys(script.received)[1]) == 32


PASSING = [HANG_UP, SIGN_IN, Said(302, b""), Said(204, b""), Said(201, b"stored, honestly")]
PASSING += [Said(status, BUSY) for status in (401, 403, 407, 408, 425, 429, 500, 502, 503, 504)]


@pytest.mark.parametrize("failure", PASSING, ids=lambda said: "cut" if said.hang_up else str(said.status))
def test_what_may_pass_is_waited_for(path: Path, failure: Said) -> None:
    with scripted(failure, failure, AGAIN) as script, client(script, path) as robot:
        robot.location("door").observe([0.0], [1])
        assert robot.outbox.flush(WAIT_S)
        assert robot.outbox.refused() == []
    assert len(script.received) == 3
    assert len(set(keys(script.received))) == 1
    assert len({request.content for request in script.received}) == 1


@pytest.mark.parametrize("status", [400, 404, 409, 411, 413, 415, 422])
def test_what_is_refused_is_put_aside_and_blocks_nothing(path: Path, status: int) -> None:
    refusal = Said(status, WRONG.body | {"status": status})
    with scripted(refusal, OK) as script, client(script, path) as robot:
        door = robot.location("door")
        door.observe([0.0], [2], idempotency_key="bad")
        door.observe([1.0], [1], idempotency_key="good")
        assert robot.outbox.flush(WAIT_S)
        (refused,) = robot.outbox.refused()
        assert (refused.path, refused.key, refused.status, refused.tries) == ("/locations/door", "bad", status, 1)
        assert refused.measurements == 1
        assert "Send this again." in refused.error
        assert "state[0]: a state is 0 or 1" in refused.error
    assert keys(script.received) == ["bad", "good"]


def test_the_refused_is_kept_until_somebody_decides(path: Path) -> None:
    with scripted(WRONG, WRONG, OK) as script:
        with client(script, path) as robot:
            robot.location("door").observe([0.0], [2])
            robot.location("door").observe([1.0], [2])
            assert robot.outbox.flush(WAIT_S)
        with client(script, path) as robot:
            first, second = robot.outbox.refused()
            robot.outbox.retry(first.id)
            assert robot.outbox.flush(WAIT_S)
            robot.outbox.discard(second.id)
            assert robot.outbox.refused() == []
            with pytest.raises(OutboxError, match=f"no refused batch has the id {second.id}"):
                robot.outbox.retry(second.id)
    assert keys(script.received)[2] == keys(script.received)[0]


def test_a_location_that_fails_holds_up_no_other(path: Path) -> None:
    slow = RetryPolicy(first_s=0.3, max_s=0.3)
    with scripted(Said(500, BUSY), OK) as script, client(script, path, retry=slow) as robot:
        for name in ("broken", "broken", "fine"):
            robot.location(name).observe([0.0], [1])
        until(lambda: len(script.received) == 4)
        assert robot.outbox.flush(WAIT_S)
    assert [request.path.split("/")[4] for request in script.received] == ["broken", "fine", "broken", "broken"]


def test_a_server_that_is_busy_is_left_alone_as_long_as_it_asks(path: Path) -> None:
    busy = Said(503, BUSY, {"Retry-After": "1"})
    with scripted(busy, OK) as script, client(script, path) as robot:
        began = time.monotonic()
        robot.location("door").observe([0.0], [1])
        until(lambda: robot.outbox.pending.last_error is not None)
        assert "Send this again." in str(robot.outbox.pending.last_error)
        assert robot.outbox.flush(WAIT_S)
        assert time.monotonic() - began >= 1
    assert len(script.received) == 2


def test_flush_does_not_wait_for_the_end_of_a_pause(path: Path) -> None:
    patient = RetryPolicy(first_s=500, max_s=500)
    with scripted(HANG_UP, OK) as script, client(script, path, retry=patient) as robot:
        robot.location("door").observe([0.0], [1])
        until(lambda: robot.outbox.pending.last_error is not None)
        assert robot.outbox.flush(WAIT_S)


def test_flush_says_when_it_was_not_enough(path: Path) -> None:
    with scripted(Said(401, BUSY)) as script, client(script, path) as robot:
        robot.location("door").observe([0.0], [1])
        assert not robot.outbox.flush(0.1)
        assert robot.outbox.pending.batches == 1


def test_closing_loses_nothing_and_the_next_client_goes_on(path: Path) -> None:
    with scripted(Said(503, BUSY)) as script, client(script, path) as robot:
        for second in range(5):
            robot.location("door").observe([float(second)], [1], idempotency_key=str(second))
    with pytest.raises(OutboxError, match="closed"):
        robot.location("door").observe([9.0], [1])
    robot.close()
    with scripted(OK) as script:
        robot = client(script, path)
        robot.close(flush_s=WAIT_S)
    assert keys(script.received) == ["0", "1", "2", "3", "4"]


def test_closing_does_not_wait_for_a_server_that_hangs(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tidemap.client.outbox.sender.STOP_S", 0.2)
    hangs, asked = threading.Event(), threading.Event()

    class Hanging(Said):
        @property
        def status(self) -> int:
            asked.set()
            hangs.wait(WAIT_S)
            return 201

        @status.setter
        def status(self, _: int) -> None: ...

    with scripted(Hanging(body=STORED)) as script:
        robot = client(script, path)
        robot.location("door").observe([0.0], [1])
        assert asked.wait(WAIT_S)
        began = time.monotonic()
        robot.close()
        assert time.monotonic() - began < WAIT_S / 2
        hangs.set()
        with client(script, path) as robot:
            assert robot.outbox.flush(WAIT_S)
    assert len(set(keys(script.received))) == 1


def test_more_than_a_post_holds_is_queued_whole_or_not_at_all(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tidemap.client.encoding.batches.__defaults__", (2,))
    with scripted(OK) as script, client(script, path, outbox_bytes=2000) as robot:
        door = robot.location("door")
        assert door.observe(range(5), [0] * 5, idempotency_key="k") == Queued(3, 5)
        assert robot.outbox.flush(WAIT_S)
        with pytest.raises(OutboxFullError, match="may hold 2000 bytes"):
            door.observe(range(50), [0] * 50)
        assert robot.outbox.pending == Pending(0, 0)
    assert keys(script.received) == ["k-0", "k-1", "k-2"]


def test_cells_as_rows_need_no_server(path: Path) -> None:
    with scripted(OK) as script, client(script, path) as robot:
        lab = robot.location("lab")
        lab.observe([1, 0, 1], [0, 1, 1], np.array([[0, 0, 1], [3, 2, 1], [0, 1, 0]]))
        lab.observe_grid(2, occupied=[[1, 0, 0]])
        lab.observe_grid(3, occupied=[[1, 0, 0]], free=[[0, 0, 0], [0, 0, 1]])
        assert robot.outbox.flush(WAIT_S)
        with pytest.raises(ValueError, match="a state is 0"):
            lab.observe([1], [2], [[0, 0, 1]])
        with pytest.raises(ValueError, match="whole numbers"):
            lab.observe([1], [1], [[0, 0, 0.5]])  # type: ignore[arg-type]
        assert robot.outbox.pending.batches == 0
    assert [json.loads(request.content)["observations"] for request in script.received] == [
        [
            {"time": 0.0, "occupied": [[3, 2, 1]], "free": []},
            {"time": 1.0, "occupied": [[0, 1, 0]], "free": [[0, 0, 1]]},
        ],
        [{"time": 2.0, "occupied": [[1, 0, 0]], "free": []}],
        [{"time": 3.0, "occupied": [[1, 0, 0]], "free": [[0, 0, 0], [0, 0, 1]]}],
    ]


def test_cells_are_indices_or_rows_and_not_both() -> None:
    with pytest.raises(ValueError, match="both as linear indices or both as rows"):
        sighting("/locations/lab", 0, [[0, 0, 1]], [3])
    with pytest.raises(ValueError, match="whole numbers from 0"):
        observation("/locations/lab", [0], [1], [[-1, 2]])


def test_several_clients_on_one_file_send_every_batch_once(path: Path) -> None:
    with scripted(OK) as script:
        robots = [client(script, path) for _ in range(3)]
        for second in range(30):
            robots[second % 3].location("door").observe([float(second)], [1], idempotency_key=str(second))
        robots[0].close()
        robots[1].close()
        assert robots[2].outbox.flush(WAIT_S)
        robots[2].close()
    assert keys(script.received) == [str(second) for second in range(30)]


def test_the_log_says_why_the_outbox_waits_and_what_was_refused(path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING, "tidemap.client.outbox")
    busy = Said(503, BUSY)
    with scripted(busy, busy, busy, WRONG) as script, client(script, path) as robot:
        robot.location("door").observe([0.0], [2])
        assert robot.outbox.flush(WAIT_S)
    waited, refused = [record.getMessage() for record in caplog.records]
    assert "waits" in waited
    assert "refused 1 measurements" in refused


def test_a_file_that_fails_is_said_and_sending_goes_on_later(
    path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    failures = [OutboxError("the disk is full"), RuntimeError("a mistake of ours")]
    from tidemap.client.outbox.store import OutboxStore

    sent = OutboxStore.sent

    def fails(self: OutboxStore, number: int) -> None:
        if failures:
            raise failures.pop(0)
        sent(self, number)

    monkeypatch.setattr(OutboxStore, "sent", fails)
    with scripted(OK, AGAIN) as script, client(script, path) as robot:
        robot.location("door").observe([0.0], [1])
        assert robot.outbox.flush(WAIT_S)
    assert len(script.received) == 3
    assert len(set(keys(script.received))) == 1
    assert ["the disk is full" in record.getMessage() for record in caplog.records] == [True, False]
    assert [record.exc_info is None for record in caplog.records] == [True, False]


def test_a_client_without_outbox_says_so() -> None:
    with Client("http://127.0.0.1:1") as robot, pytest.raises(OutboxError, match="outbox=PATH"):
        _ = robot.outbox


def test_the_asynchronous_client_queues_too(path: Path) -> None:
    async def run(url: str) -> None:
        async with AsyncClient(url, retry=QUICK, outbox=path) as robot:
            door = robot.location("door")
            assert await door.observe([0.0], [1], idempotency_key="first") == Queued(1, 1)
            assert await door.observe([0.0], [2], idempotency_key="bad") == Queued(1, 1)
            assert await robot.outbox.flush(WAIT_S)
            (refused,) = await robot.outbox.refused()
            await robot.outbox.retry(refused.id)
            assert await robot.outbox.flush(WAIT_S)
            (refused,) = await robot.outbox.refused()
            await robot.outbox.discard(refused.id)
            assert robot.outbox.pending == Pending(0, 0)
            assert robot.outbox.path == path
            await asyncio.gather(*(door.observe([float(t)], [1]) for t in range(20)))
            await robot.close(flush_s=WAIT_S)

    with scripted(HANG_UP, OK, WRONG, WRONG, OK) as script:
        asyncio.run(run(script.url))
    assert keys(script.received)[:4] == ["first", "first", "bad", "bad"]
    assert len(set(keys(script.received)[4:])) == 20


def test_pauses_double_until_the_server_answers_and_respect_what_it_asks() -> None:
    now = [100.0]
    backoff = Backoff(RetryPolicy(first_s=1, max_s=4), lambda: now[0])
    assert (backoff.left_s(), backoff.paths(), backoff.next_s()) == (0, [], float("inf"))
    for longest in (1, 2, 4, 4):
        backoff.failed(ALL, None)
        assert longest / 2 <= backoff.left_s() <= longest
    backoff.failed("a", 10)
    backoff.failed("b", None)
    assert backoff.paths() == ["a", "b"]
    assert backoff.next_s() <= 1
    backoff.hurry()
    assert (backoff.left_s(), backoff.paths(), backoff.next_s()) == (0, ["a"], 10)
    now[0] += 10
    assert backoff.paths() == []
    backoff.failed("a", 1e9)
    assert backoff.next_s() == 900
    backoff.answered("a")
    backoff.failed(ALL, None)
    assert backoff.left_s() <= 1


@pytest.mark.parametrize("error", [httpx.ReadTimeout("slow"), httpx.DecodingError("no gzip")])
def test_a_failure_of_one_request_says_nothing_of_others(error: httpx.RequestError) -> None:
    assert judge("/locations/door", error).outcome is SendOutcome.WAIT
    assert judge("/locations/door", httpx.ConnectError("down")).outcome is SendOutcome.ALL_WAIT

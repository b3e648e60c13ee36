"""Told to stop, the server answers every post that it is being sent, stores what it acknowledged, and takes no more."""

import json
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing

import httpx
import pytest

from tests.support.server import ServerProcess, StartServer

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
        self._socket = socket.create_connection(("127.0.0.1", server.port), timeout=30)
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
            socket.create_connection(("127.0.0.1", server.port), timeout=5).close()
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
    return httpx.Client(base_url=f"{server.url}/api/v1", timeout=30, trust_env=False)


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

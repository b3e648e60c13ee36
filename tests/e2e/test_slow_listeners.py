"""Listeners that do not keep up are dropped, and nobody else notices."""

import json
import socket as sockets
import struct
import time
from base64 import b64encode

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.connection import Connection

from tests.support.memory import memory_mb
from tests.support.server import StartServer
from tests.support.site import Site, listen_for
from tests.support.waiting import WAIT_S
from tidemap.services.listing import MAX_CELLS

SHAPE = (64, 64, 4)
CELLS = list(range(64 * 64 * 4))
MEMORY_MB = 150
POSTS = 120
"""Twice as many events as the system holds for a listener before its queue here begins to fill."""
PROMPT_S = 1.0


class Stuck:
    """A listener that shakes hands and then never reads, its buffer as small as can be."""

    def __init__(self, port: int, query: str = "") -> None:
        self.socket = sockets.socket()
        self.socket.setsockopt(sockets.SOL_SOCKET, sockets.SO_RCVBUF, 2048)
        self.socket.connect(("127.0.0.1", port))
        key = b64encode(b"0123456789abcdef").decode()
        self.socket.sendall(
            f"GET /api/v1/events{query} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\n"
            f"Connection: Upgrade\r\nSec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
        )
        head = b""
        while not head.endswith(b"\r\n\r\n"):
            head += self.socket.recv(1)
        assert b" 101 " in head.split(b"\r\n")[0], head

    def rest(self) -> bytes:
        """All that waits in the socket, up to its end."""
        self.socket.settimeout(10)
        parts = []
        while part := self.socket.recv(1 << 16):
            parts.append(part)
        return b"".join(parts)

    def close(self) -> None:
        self.socket.close()


def close_code(frames: bytes) -> int | None:
    """The code of the close frame among unmasked frames."""
    at = 0
    while at + 2 <= len(frames):
        opcode, length, at = frames[at] & 15, frames[at + 1] & 127, at + 2
        if length == 126:
            (length,), at = struct.unpack_from(">H", frames, at), at + 2
        elif length == 127:
            (length,), at = struct.unpack_from(">Q", frames, at), at + 8
        if opcode == 8:
            return int(struct.unpack_from(">H", frames, at)[0])
        at += length
    return None


class Hall:
    """A large empty hall; events of it are so large that no buffer on the way holds many."""

    def __init__(self, site: Site) -> None:
        self._site = site
        self._moments = iter(range(0, 100_000, 2))
        grid = {"resolution_m": 1, "shape": SHAPE}
        form = {
            "name": "hall",
            "kind": "grid3d",
            "interval_s": 1,
            "estimator": "static",
            "grid": grid,
            "confidence": 0.7,
        }
        assert site.http.post("/locations", json=form).status_code == 201
        self.look("free")
        assert site.update("hall")["state"] == "done"

    def look(self, kind: str = "occupied") -> float:
        """All cells are seen free or occupied; how long the post took."""
        body = json.dumps({"observations": [{"time": next(self._moments), kind: CELLS}]})
        began = time.monotonic()
        headers = {"Content-Type": "application/json"}
        answer = self._site.http.post("/locations/hall/observations", content=body, headers=headers)
        assert answer.status_code == 201, answer.text
        return time.monotonic() - began


def middle(values: list[float]) -> float:
    return sorted(values)[len(values) // 2]


def test_a_stuck_listener_is_dropped_and_slows_nobody(server: StartServer) -> None:
    running = server(env={"TIDEMAP_VIEWER": "false", "TIDEMAP_UPDATER": "false", "TIDEMAP_SOCKET_QUEUE": "16"})
    with Site(running) as site:
        hall = Hall(site)
        alone = middle([hall.look() for _ in range(10)])
        before = memory_mb(running.process.pid)
        stuck = [Stuck(running.port) for _ in range(3)]
        with site.events("?kind=anomaly") as lively:
            taken, told = [], []
            for _ in range(POSTS):
                began = time.monotonic()
                taken.append(hall.look())
                (message,) = listen_for(lively, 1)
                told.append(time.monotonic() - began)
                assert (len(message["cells"]), message["cells_total"]) == (MAX_CELLS, len(CELLS))
            assert min(told) < PROMPT_S
            assert min(taken) < 3 * alone + 0.05
            assert memory_mb(running.process.pid) < before + MEMORY_MB
            for each in stuck:
                received = each.rest()  # what the system held for it; the code itself it was too slow to get
                assert close_code(received) in (1013, None)
                assert len(received) < POSTS * len(message["cells"]) * 4, "it was dropped before it had everything"
            hall.look()
            assert len(listen_for(lively, 1)) == 1
        for each in stuck:
            each.close()
    assert running.stop() == 0


def test_a_listener_that_reads_on_is_told_why_it_was_dropped(server: StartServer) -> None:
    """It reads nothing for a while, then all that waits, and finds the code at the end."""
    running = server(env={"TIDEMAP_VIEWER": "false", "TIDEMAP_UPDATER": "false", "TIDEMAP_SOCKET_QUEUE": "4"})
    with Site(running) as site:
        hall = Hall(site)
        with site.events("?kind=anomaly", max_queue=1) as connection:
            for _ in range(POSTS):
                hall.look()
            with pytest.raises(ConnectionClosed) as closed:
                read_all(connection)
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 1013
    assert "after" in closed.value.rcvd.reason


def read_all(connection: Connection) -> None:
    while True:
        connection.recv(timeout=WAIT_S)

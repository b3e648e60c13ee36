"""Connections that are not meant well: endless heads, one connection too many, refused WebSockets."""

import json
import socket
from contextlib import ExitStack, suppress

import httpx
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from tests.e2e.test_keys import make_key
from tests.support.memory import memory_mb
from tests.support.server import ServerProcess, StartServer

LIMIT = 12
FLOOD_BYTES = 64 * 2**20
ENOUGH_MB = 32
"""What the server's memory may grow by while FLOOD_BYTES come in."""


@pytest.fixture(scope="module")
def closed(module_server: StartServer) -> ServerProcess:
    """A server with a key, so that a stranger may do nothing, and with few connections."""
    env = {"TIDEMAP_VIEWER": "false", "TIDEMAP_MAX_CONNECTIONS_PER_ADDRESS": str(LIMIT)}
    running = module_server(env=env)
    make_key(("--data", str(running.data)), "admin")
    return running


def dial(server: ServerProcess) -> socket.socket:
    return socket.create_connection(("127.0.0.1", server.port), timeout=60)


def answer(connection: socket.socket) -> bytes:
    """All that comes until the server closes."""
    parts = []
    with suppress(ConnectionError):
        while part := connection.recv(65536):
            parts.append(part)
    return b"".join(parts)


def flood(server: ServerProcess, head: bytes, piece: bytes) -> tuple[int, bytes]:
    """Send a head and then pieces until the server closes: how many bytes it took, and its answer."""
    sent = 0
    with dial(server) as connection:
        connection.sendall(head)
        with suppress(ConnectionError):
            while sent < FLOOD_BYTES:
                connection.sendall(piece)
                sent += len(piece)
        return sent, answer(connection)


UPGRADE = (
    b"Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
    b"Sec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n"
)
LINES = b"".join(b"X-Flood-%05d: %s\r\n" % (i, b"y" * 180) for i in range(300))
FLOODS = {
    "header lines": (b"GET /healthz HTTP/1.1\r\nHost: x\r\n", LINES),
    "header lines of a WebSocket": (b"GET /api/v1/events HTTP/1.1\r\nHost: x\r\n" + UPGRADE, LINES),
    "one header line": (b"GET /healthz HTTP/1.1\r\nHost: x\r\nX-Long: ", b"y" * 65536),
    "a header's name": (b"GET /healthz HTTP/1.1\r\nHost: x\r\n", b"y" * 65536),
    "the address": (b"GET /", b"y" * 65536),
    "trailers": (
        b"POST /healthz HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n1\r\nx\r\n0\r\n",
        LINES,
    ),
    "one trailer": (
        b"POST /healthz HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n1\r\nx\r\n0\r\nX: ",
        b"y" * 65536,
    ),
    "a chunk's extension": (
        b"POST /healthz HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n1;",
        b"y" * 65536,
    ),
    "empty lines": (b"", b"\r\n" * 32768),
}


@pytest.mark.parametrize("what", FLOODS)
def test_a_head_without_end_is_cut_off(closed: ServerProcess, what: str) -> None:
    before = memory_mb(closed.process.pid)
    sent, _ = flood(closed, *FLOODS[what])
    assert sent < FLOOD_BYTES, "the server took all of it"
    assert memory_mb(closed.process.pid) - before < ENOUGH_MB
    assert httpx.get(f"{closed.url}/healthz", trust_env=False).status_code == 200


def test_a_head_that_is_a_little_too_large_is_told_why(closed: ServerProcess) -> None:
    many = {f"X-{i}": "y" for i in range(101)}
    long = {"X-Long": "y" * 70_000}
    for headers in (many, long):
        told = httpx.get(f"{closed.url}/healthz", headers=headers, trust_env=False)
        assert told.status_code == 431
        assert told.headers["content-type"] == "application/problem+json"
        assert "64 kB and 100 lines" in told.json()["detail"]
    enough = httpx.get(f"{closed.url}/healthz", headers={f"X-{i}": "y" * 500 for i in range(90)}, trust_env=False)
    assert enough.status_code == 200


def test_what_is_no_request_is_told_so(closed: ServerProcess) -> None:
    with dial(closed) as connection:
        connection.sendall(b"\x16\x03\x01 no request\r\n\r\n")
        head, _, body = answer(connection).partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 400 ")
    assert json.loads(body)["status"] == 400


def test_a_body_in_the_smallest_chunks_is_read(closed: ServerProcess) -> None:
    """The lengths of chunks count as overhead, but never so that an honest sender is refused."""
    body = b"".join(b"1\r\nx\r\n" for _ in range(60_000)) + b"0\r\n\r\n"
    head = (
        b"POST /api/v1/nothing HTTP/1.1\r\nHost: 127.0.0.1\r\nTransfer-Encoding: chunked\r\nConnection: close\r\n\r\n"
    )
    with dial(closed) as connection:
        with suppress(ConnectionError):
            connection.sendall(head + body)
        assert answer(connection).startswith(b"HTTP/1.1 404 ")


def test_an_address_has_so_many_connections_and_gets_them_back(closed: ServerProcess) -> None:
    with ExitStack() as stack:
        held = [stack.enter_context(dial(closed)) for _ in range(LIMIT)]
        for connection in held:
            connection.sendall(b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n")
            assert connection.recv(65536).startswith(b"HTTP/1.1 200")
        with dial(closed) as one_more:
            refused = answer(one_more)
        assert refused.startswith(b"HTTP/1.1 503")
        assert b"retry-after: 1" in refused
    assert httpx.get(f"{closed.url}/healthz", trust_env=False).status_code == 200


def test_refused_sockets_end_quietly_and_count_no_more(closed: ServerProcess) -> None:
    printed = len(closed.output())
    for _ in range(3 * LIMIT):
        with pytest.raises(InvalidStatus) as refusal:
            connect(f"ws://127.0.0.1:{closed.port}/api/v1/events", proxy=None)
        assert refusal.value.response.status_code == 401
    assert closed.output()[printed:] == ""

"""How long a connection may take over its request."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import pytest
import uvicorn
from uvicorn.server import ServerState

from tidemap.server import protocol
from tidemap.server.census import Census
from tidemap.server.protocol import BoundedHttpProtocol


async def answer_at_once(scope: Any, _: Callable[[], Awaitable[Any]], send: Callable[[Any], Awaitable[None]]) -> None:
    """Answers without reading the body."""
    assert scope["type"] == "http"
    await send({"type": "http.response.start", "status": 204, "headers": []})
    await send({"type": "http.response.body", "body": b""})


def exchange(*parts: bytes, census: Census | None = None) -> bytes:
    """Send requests to a connection of this protocol, each after the answer before, and read until it is closed."""

    async def scenario() -> bytes:
        config = uvicorn.Config(answer_at_once, log_config=None, lifespan="off")
        state, open_ = ServerState(), census or Census(10, 10)

        def make() -> asyncio.Protocol:
            return BoundedHttpProtocol(config=config, server_state=state, app_state={}, census=open_)

        server = await asyncio.get_running_loop().create_server(make, "127.0.0.1", 0)
        async with server:
            port = server.sockets[0].getsockname()[1]
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            answers = b""
            try:
                for part in parts:
                    answers += await reader.readuntil(b"\r\n\r\n") if part is not parts[0] else b""
                    writer.write(part)
                return answers + await reader.read()
            finally:
                writer.close()

    return asyncio.run(scenario())


@pytest.mark.parametrize("begun", [b"", b"GET / HTTP/1.1\r\nHost:", b"\r\n\r\n"])
def test_a_head_has_to_come_soon(monkeypatch: pytest.MonkeyPatch, begun: bytes) -> None:
    monkeypatch.setattr(protocol, "MAX_HEAD_S", 0.02)
    assert exchange(begun).startswith(b"HTTP/1.1 408 ")


def test_so_does_the_next_head_of_a_connection(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(protocol, "MAX_HEAD_S", 0.1)
    told = exchange(b"GET / HTTP/1.1\r\nHost: x\r\n\r\n", b"GET / HTTP/1.1\r\nHost:")
    assert told.startswith(b"HTTP/1.1 204 ")
    assert b"HTTP/1.1 408 " in told


def test_a_body_that_is_answered_already_does_not_hold_the_connection(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(protocol, "MAX_LINGER_S", 0.02)
    assert exchange(b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 1000\r\n\r\n1").startswith(b"HTTP/1.1 204 ")


def test_a_closed_connection_leaves_the_census(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(protocol, "MAX_HEAD_S", 0.02)
    census = Census(1, 1)
    for _ in range(3):
        assert exchange(b"GET ", census=census).startswith(b"HTTP/1.1 408 ")

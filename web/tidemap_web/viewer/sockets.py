"""The sockets of a tab: one with its page, one between its browser and viser."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Coroutine
from typing import Any

from fastapi import WebSocket, WebSocketDisconnect
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, WebSocketException
from websockets.typing import Subprotocol

from tidemap.api.auth import ENDED, until_ended
from tidemap.errors import TooManyTabsError
from tidemap.services.keys import Principal
from tidemap_web.viewer import report
from tidemap_web.viewer.messages import PageMessage, Ping, parse
from tidemap_web.viewer.server import ViewerServer

TOO_MANY = (1013, "too many tabs are open with this key")


class SendQueue:
    """Messages on their way to a page; the newest of a kind replaces one that has not left yet."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._waiting: dict[str, PageMessage] = {}
        self._filled = asyncio.Event()

    def put(self, message: PageMessage) -> None:
        """Leave a message; from any thread, never waits."""
        with contextlib.suppress(RuntimeError):  # the loop has closed: nobody is left to read
            self._loop.call_soon_threadsafe(self._keep, message)

    def _keep(self, message: PageMessage) -> None:
        self._waiting.pop(message["kind"], None)
        self._waiting[message["kind"]] = message
        self._filled.set()

    async def taken(self) -> AsyncIterator[PageMessage]:
        """Messages in the order they came, for ever."""
        while True:
            await self._filled.wait()
            self._filled.clear()
            while self._waiting:
                yield self._waiting.pop(next(iter(self._waiting)))


async def converse(socket: WebSocket, viewer: ViewerServer, token: str, principal: Principal) -> None:
    """Run a session, which sees what its principal may, for as long as its page stays."""
    outbox = SendQueue()
    try:
        session = viewer.open(token, outbox.put, principal)
    except TooManyTabsError as error:
        await socket.send_json(report.notice("too-many", str(error)))
        await socket.close(*TOO_MANY)
        return

    async def speak() -> None:
        async for message in outbox.taken():
            await socket.send_json(message)

    async def listen() -> None:
        async for data in _received(socket):
            try:
                asked = parse(data)
                if isinstance(asked, Ping):
                    outbox.put({"kind": "pong"})
                else:
                    session.ask(asked)
            except ValueError as error:
                outbox.put({"kind": "refused", "detail": str(error)})

    try:
        await _first_of(speak(), listen(), _close_when_ended(socket))
    finally:
        viewer.close(session)


async def pipe(socket: WebSocket, viewer: ViewerServer, token: str) -> None:
    """Pass frames both ways unchanged until either end closes."""
    protocols = [Subprotocol(name) for name in socket.scope.get("subprotocols", [])]
    address = f"ws://127.0.0.1:{viewer.port}/?token={token}"
    try:
        inner = await connect(
            address,
            additional_headers=viewer.headers,
            proxy=None,
            subprotocols=protocols or None,
            max_size=None,
            compression=None,
            ping_interval=None,
        )
    except (OSError, WebSocketException):
        await socket.close(1013)
        return
    async with inner:
        await socket.accept(subprotocol=inner.subprotocol)
        await _first_of(_inward(socket, inner), _outward(socket, inner), _close_when_ended(socket))
        with contextlib.suppress(RuntimeError, WebSocketDisconnect):
            await socket.close(1001)


async def _close_when_ended(socket: WebSocket) -> None:
    await until_ended(socket)
    await socket.close(*ENDED)


async def _received(socket: WebSocket) -> AsyncIterator[bytes | str]:
    """Whatever comes in, until the sender leaves."""
    while (message := await socket.receive())["type"] == "websocket.receive":
        data: bytes | str | None = message.get("bytes")
        yield message["text"] if data is None else data


async def _inward(socket: WebSocket, inner: ClientConnection) -> None:
    async for data in _received(socket):
        await inner.send(data)


async def _outward(socket: WebSocket, inner: ClientConnection) -> None:
    async for data in inner:
        if isinstance(data, bytes):
            await socket.send_bytes(data)
        else:
            await socket.send_text(data)


async def _first_of(*ways: Coroutine[Any, Any, None]) -> None:
    """Run until the first ends, then end the others; a closed connection is an ordinary end."""
    tasks = [asyncio.create_task(way) for way in ways]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        for outcome in await asyncio.gather(*tasks, return_exceptions=True):
            if isinstance(outcome, Exception) and not isinstance(
                outcome, ConnectionClosed | WebSocketDisconnect | RuntimeError
            ):
                raise outcome

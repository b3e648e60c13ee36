"""Readers of events in a process of their own: how long each message took to them.

They read bytes and look for the numbers of observations in them: to parse each message four hundred times would
measure this process.
"""

import asyncio
import multiprocessing
import re
import socket
import time
from base64 import b64encode
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from multiprocessing.connection import Connection

_processes = multiprocessing.get_context("spawn")
_NUMBER = re.compile(rb'"id":(\d+)')
REQUESTS = {
    "websocket": "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: "
    + b64encode(b"0123456789abcdef").decode(),
    "sse": "Accept: text/event-stream",
}


@dataclass(slots=True)
class Heard:
    """By transport: (number of the observation, when it came), of all readers; how many readers were cut off."""

    came: dict[str, list[tuple[int, float]]] = field(default_factory=dict)
    ended: int = 0


class Reader(asyncio.Protocol):
    """One reader, which notes when which observation came."""

    def __init__(self, port: int, transport: str, heard: Heard) -> None:
        self._head = _request(port, transport)
        self._came = heard.came.setdefault(transport, [])
        self._heard = heard
        self._rest = b""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Ask."""
        self._transport = transport
        if isinstance(transport, asyncio.WriteTransport):
            transport.write(self._head)

    def data_received(self, data: bytes) -> None:
        """Note what came."""
        now = time.monotonic()
        if (ping := data.find(b"\x89\x04")) >= 0 and isinstance(self._transport, asyncio.WriteTransport):
            self._transport.write(b"\x8a\x84\0\0\0\0" + data[ping + 2 : ping + 6])
        data = self._rest + data
        end = 0
        for found in _NUMBER.finditer(data):
            end = found.end()
            self._came.append((int(found[1]), now))
        # A number may be cut in two.
        self._rest = data[max(end, len(data) - 40) :]

    def connection_lost(self, exc: Exception | None) -> None:
        """It was cut off, or this is the end."""
        self._heard.ended += 1


@contextmanager
def listening(port: int, each: int) -> Iterator[Heard]:
    """`each` readers of each transport listen meanwhile; fills what it yields at the end."""
    heard = Heard()
    here, there = _processes.Pipe()
    process = _processes.Process(target=_read, args=(port, each, there))
    process.start()
    here.recv()
    try:
        yield heard
    finally:
        here.send(None)
        heard.came, heard.ended = here.recv()
        process.join()


def _read(port: int, each: int, pipe: Connection) -> None:
    asyncio.run(_readers(port, each, pipe))


async def _readers(port: int, each: int, pipe: Connection) -> None:
    loop, heard = asyncio.get_running_loop(), Heard()
    for transport in REQUESTS:
        for _ in range(each):
            await loop.create_connection(partial(Reader, port, transport, heard), "127.0.0.1", port)
    await asyncio.sleep(1)
    pipe.send(None)
    while not pipe.poll():
        await asyncio.sleep(0.05)
    pipe.recv()
    pipe.send((heard.came, heard.ended))


def stuck(port: int, transport: str) -> socket.socket:
    """A reader that asks and never reads, its buffer as small as can be."""
    made = socket.socket()
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
    made.connect(("127.0.0.1", port))
    made.sendall(_request(port, transport))
    return made


def _request(port: int, transport: str) -> bytes:
    head = f"GET /api/v1/events?kind=observation HTTP/1.1\r\nHost: 127.0.0.1:{port}"
    return f"{head}\r\n{REQUESTS[transport]}\r\n\r\n".encode()

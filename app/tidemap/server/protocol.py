"""HTTP and WebSocket connections with bounds: on the request's head, on the time it takes, on connections.

uvicorn's httptools protocol has no bound on any of them. A head is the request line with the header lines; trailers
and the lengths of chunks count as part of it.
"""

import socket
from asyncio import BaseTransport, TimerHandle
from collections.abc import Sequence
from functools import partial
from http import HTTPStatus
from typing import Any

import httptools
import orjson
from uvicorn.protocols.http.httptools_impl import STATUS_LINE, HttpToolsProtocol
from uvicorn.protocols.utils import ClientDisconnected
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.http11 import Request

from tidemap.api.connections import ABORT, BOUND_BUFFER, SEND_TEXTS
from tidemap.media_types import PROBLEM
from tidemap.server.census import Census

MAX_HEAD_BYTES = 64 * 2**10
MAX_HEAD_LINES = 100
MAX_HEAD_S = 10.0
MAX_LINGER_S = 5.0
"""How long the rest of a body may take whose request is answered already."""
MAX_WAITING_BYTES = 1 << 18
"""What the system holds for a reader of events, who is noticed sooner so when they do not keep up."""
MAX_CLOSE_S = 30.0
"""How long a WebSocket may take to close; then its connection is cut off."""
CHUNK_OVERHEAD = 16
"""Bytes around each byte of a body that arrives in the smallest of chunks."""


class HeadTooLargeError(Exception):
    """The head is longer than the bounds; raised within the parser, which stops."""


class BoundedHttpProtocol(HttpToolsProtocol):
    """An HTTP connection that refuses endless heads (431), slow ones (408) and one connection too many (503)."""

    def __init__(self, *args: Any, census: Census, **how: Any) -> None:
        super().__init__(*args, **how)
        self._census = census
        self._address: str | None = None
        self._deadline: TimerHandle | None = None
        self._lines = 0
        self._parsed = 0
        self._raw = 0
        self._body = 0
        self._reading_body = False

    def connection_made(self, transport: BaseTransport) -> None:
        """Count the connection; its first head has to come soon."""
        super().connection_made(transport)  # type: ignore[arg-type]
        address = self.client[0] if self.client else ""
        if self._census.enter(address):
            self._address = address
            self._expect(MAX_HEAD_S)
        else:
            self._refuse(503, "Too many connections are open. Close some, or try again in a second.")

    def connection_lost(self, exc: Exception | None) -> None:
        """The connection counts no more."""
        self._settle()
        self._leave()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Parse what has come, within the bounds."""
        self._unset_keepalive_if_required()
        if self.transport.is_closing():
            return
        if self._deadline is None and not self._reading_body:
            self._expect(MAX_HEAD_S)
        before = self._raw
        self._raw += len(data)
        try:
            self.parser.feed_data(data)
        except httptools.HttpParserUpgrade:
            self._upgrade()
            return
        except httptools.HttpParserError as error:
            self._refuse_head(isinstance(error.__context__, HeadTooLargeError))
            return
        if before and self._raw - self._body > MAX_HEAD_BYTES + CHUNK_OVERHEAD * self._body:
            self._refuse_head(too_large=True)

    def on_message_begin(self) -> None:
        """A new head."""
        super().on_message_begin()
        bound = partial(bound_buffer, self.transport)
        self.scope["extensions"] = {ABORT: self.transport.abort, BOUND_BUFFER: bound}  # type: ignore[dict-item]
        self._lines = self._parsed = self._raw = self._body = 0

    def on_url(self, url: bytes) -> None:
        """A part of the request line."""
        self._count(len(url))
        super().on_url(url)

    def on_header(self, name: bytes, value: bytes) -> None:
        """A header line, or a trailer."""
        self._lines += 1
        self._count(len(name) + len(value) + len(b": \r\n"))
        super().on_header(name, value)

    def on_headers_complete(self) -> None:
        """The head is complete; how long the body may take is its reader's business."""
        self._settle()
        self._reading_body = True
        super().on_headers_complete()

    def on_body(self, body: bytes) -> None:
        """A part of the body."""
        self._body += len(body)
        super().on_body(body)

    def on_message_complete(self) -> None:
        """The request is complete."""
        self._reading_body = False
        self._raw = 0
        self._settle()
        super().on_message_complete()

    def on_response_complete(self) -> None:
        """Answered; a body that is not complete has a moment left."""
        super().on_response_complete()
        if self._reading_body and not self.transport.is_closing():
            self._deadline = self.loop.call_later(MAX_LINGER_S, self.transport.close)

    def _count(self, n_bytes: int) -> None:
        self._parsed += n_bytes
        if self._parsed > MAX_HEAD_BYTES or self._lines > MAX_HEAD_LINES:
            raise HeadTooLargeError

    def _upgrade(self) -> None:
        if self._should_upgrade():
            address, self._address = self._address, None
            self.handle_websocket_upgrade()
            protocol = self.transport.get_protocol()
            if isinstance(protocol, BoundedWebSocketProtocol):
                protocol.counted(self._census, address)

    def _expect(self, seconds: float) -> None:
        self._deadline = self.loop.call_later(seconds, self._too_slow)

    def _settle(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None

    def _too_slow(self) -> None:
        self._refuse(408, f"The head of the request was not complete within {MAX_HEAD_S:g} s.")

    def _refuse_head(self, too_large: bool) -> None:
        if too_large:
            bounds = f"{MAX_HEAD_BYTES // 2**10} kB and {MAX_HEAD_LINES} lines"
            self._refuse(431, f"The head of a request may have {bounds}, trailers included. Send less.")
        else:
            self._refuse(400, "This is no HTTP/1.1 request.")

    def _refuse(self, status: int, detail: str) -> None:
        """Answer with a problem document, unless another answer is on its way, and close."""
        self._settle()
        if not self.transport.is_closing():
            if self.cycle is None or self.cycle.response_complete:
                self.transport.write(problem(status, detail))
            self.transport.close()

    def _leave(self) -> None:
        if self._address is not None:
            self._census.leave(self._address)
            self._address = None


class BoundedWebSocketProtocol(WebSocketsSansIOProtocol):
    """A WebSocket that counts as a connection, and whose refusal is complete when it has been sent."""

    _census: Census | None = None
    _address: str | None = None

    def counted(self, census: Census, address: str | None) -> None:
        """Leave `census` when the connection closes."""
        self._census, self._address = census, address

    def handle_connect(self, event: Request) -> None:
        """As uvicorn, with our extensions; the application begins later."""
        super().handle_connect(event)
        if not self.handshake_complete:
            ours = {SEND_TEXTS: self.send_texts, BOUND_BUFFER: partial(bound_buffer, self.transport)}
            self.scope["extensions"].update(ours)  # type: ignore[arg-type]

    async def send_texts(self, texts: Sequence[bytes]) -> None:
        """Send text messages in one write. Raises ClientDisconnected."""
        await self.writable.wait()
        if self.disconnected or self.close_sent:
            raise ClientDisconnected
        self.transport.write(b"".join(part for text in texts for part in (text_head(len(text)), text)))

    async def send(self, message: Any) -> None:
        """As uvicorn, but closing waits for no reader, and a refusal with a body ends the handshake."""
        if message["type"] == "websocket.close" and self.handshake_complete:
            # Behind what waits for a reader who does not keep up: who reads on finds out why.
            self.writable.set()
            self.loop.call_later(MAX_CLOSE_S, self.transport.abort)
        await super().send(message)
        if message["type"] == "websocket.http.response.body" and not message.get("more_body", False):
            self.handshake_complete = True

    def connection_lost(self, exc: Exception | None) -> None:
        """The connection counts no more."""
        super().connection_lost(exc)
        if self._census is not None and self._address is not None:
            self._census.leave(self._address)
            self._address = None


def bound_buffer(transport: BaseTransport) -> None:
    """Let the system hold MAX_WAITING_BYTES for the reader of a connection, or twice as many."""
    connected = transport.get_extra_info("socket")
    if connected is not None:
        connected.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, MAX_WAITING_BYTES)


def text_head(length: int) -> bytes:
    """What stands before a text message of a WebSocket that a server sends whole (RFC 6455, section 5.2).

    >>> text_head(5).hex(), text_head(300).hex(), text_head(70_000).hex()
    ('8105', '817e012c', '817f0000000000011170')
    """
    if length < 126:
        return bytes((0x81, length))
    if length < 1 << 16:
        return b"\x81\x7e" + length.to_bytes(2, "big")
    return b"\x81\x7f" + length.to_bytes(8, "big")


def problem(status: int, detail: str) -> bytes:
    """A whole response with a problem document, after which the connection closes."""
    title = HTTPStatus(status).phrase
    document = orjson.dumps({"type": "about:blank", "title": title, "status": status, "detail": detail})
    lines = [
        f"content-type: {PROBLEM}".encode(),
        b"content-length: %d" % len(document),
        b"connection: close",
        *([b"retry-after: 1"] if status == HTTPStatus.SERVICE_UNAVAILABLE else []),
    ]
    return STATUS_LINE[status] + b"\r\n".join(lines) + b"\r\n\r\n" + document

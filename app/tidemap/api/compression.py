"""Compression of answers where the asker takes it: zstd or gzip, in pieces, so that nobody waits for a large one."""

import zlib
from collections.abc import Callable
from typing import Any

import zstandard
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

MIN_BYTES = 1024
"""Shorter answers are sent as they are."""
PIECE_BYTES = 1 << 17
"""What is compressed at once; longer pieces in a thread."""
GZIP_LEVEL, ZSTD_LEVEL = 4, 3
COMPRESSED = ("application/json", "application/problem+json", "application/javascript", "image/svg+xml", "text/")
"""Media types that are worth it: numbers in Arrow and npy hardly are, and a stream of events must not wait."""
EXCLUDED = ("text/event-stream",)

ENCODINGS: dict[str, Callable[[], Any]] = {
    "zstd": lambda: zstandard.ZstdCompressor(level=ZSTD_LEVEL).compressobj(),
    "gzip": lambda: zlib.compressobj(GZIP_LEVEL, wbits=zlib.MAX_WBITS | 16),
}
"""In the order of our liking."""


class AnswerCompression:
    """ASGI middleware: answers are compressed as Accept-Encoding allows."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or scope["method"] == "HEAD":
            await self._app(scope, receive, send)
            return
        wanted = accepted(Headers(scope=scope).get("accept-encoding", ""))
        await self._app(scope, receive, CompressingSender(send, wanted))


class CompressingSender:
    """Passes an answer on, compressed where that is worth it."""

    def __init__(self, send: Send, encoding: str | None) -> None:
        self._send = send
        self._encoding = encoding
        self._start: Message | None = None
        self._packer: Any = None

    async def __call__(self, message: Message) -> None:
        """Send a part of the answer; its head waits for the first part of the body, which says how long it is."""
        if message["type"] == "http.response.start" and is_compressible(message):
            self._start = message
            return
        if self._start is not None and message["type"] == "http.response.body":
            start, self._start = self._start, None
            self._begin(start, message)
            await self._send(start)
        if self._packer is None:
            await self._send(message)
        else:
            await self._send_packed(message)

    def _begin(self, start: Message, first: Message) -> None:
        """Choose, and say so in the head."""
        headers = MutableHeaders(raw=list(start["headers"]))
        headers.add_vary_header("Accept-Encoding")
        known = len(first.get("body", b"")) if not first.get("more_body", False) else MIN_BYTES
        if self._encoding is not None and int(headers.get("content-length", known)) >= MIN_BYTES:
            self._packer = ENCODINGS[self._encoding]()
            headers["Content-Encoding"] = self._encoding
            del headers["Content-Length"]
            if (etag := headers.get("etag")) is not None and not etag.startswith("W/"):
                headers["ETag"] = f"W/{etag}"
        start["headers"] = headers.raw

    async def _send_packed(self, message: Message) -> None:
        body, more = memoryview(message.get("body", b"")), message.get("more_body", False)
        for begin in range(0, body.nbytes, PIECE_BYTES):
            piece = body.cast("B")[begin : begin + PIECE_BYTES]
            packed = await self._pack(piece)
            if packed:
                await self._send({"type": "http.response.body", "body": packed, "more_body": True})
        if not more:
            await self._send({"type": "http.response.body", "body": self._packer.flush()})

    async def _pack(self, piece: memoryview) -> bytes:
        if piece.nbytes < PIECE_BYTES // 4:
            return bytes(self._packer.compress(piece))
        return bytes(await run_in_threadpool(self._packer.compress, piece))


def is_compressible(start: Message) -> bool:
    """Whether an answer with this head may be compressed: all of it is sent, and nobody has compressed it yet."""
    headers = Headers(raw=start["headers"])
    kind = headers.get("content-type", "")
    return (
        start["status"] not in (204, 206, 304)
        and "content-encoding" not in headers
        and kind.startswith(COMPRESSED)
        and not kind.startswith(EXCLUDED)
    )


def accepted(header: str) -> str | None:
    """The best encoding that Accept-Encoding allows, None where that is none.

    >>> accepted("gzip, deflate, br, zstd"), accepted("gzip;q=0.5, zstd;q=0"), accepted("*"), accepted("identity")
    ('zstd', 'gzip', 'zstd', None)
    """
    weights = dict(_weight(part) for part in header.lower().split(",") if part.strip())
    every = weights.get("*", 0.0)
    return next((encoding for encoding in ENCODINGS if weights.get(encoding, every) > 0), None)


def _weight(part: str) -> tuple[str, float]:
    name, _, quality = part.partition(";")
    value = quality.partition("=")[2].strip()
    try:
        return name.strip(), float(value) if value else 1.0
    except ValueError:
        return name.strip(), 0.0

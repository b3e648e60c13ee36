"""Bodies: read within a limit that counts unpacked bytes, gzip or zstd unpacked on the way."""

import asyncio
import time
import zlib
from collections.abc import Callable, Coroutine, Iterator, Mapping
from typing import Any

import zstandard
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response
from starlette.types import Message, Receive

from tidemap.api.auth import authenticate
from tidemap.api.budget import Share
from tidemap.api.parameters import StrictRoute
from tidemap.api.state import state_of
from tidemap.errors import BodyStalledError, BodyTooLargeError, UnreadableBodyError, UnsupportedMediaTypeError
from tidemap.media_types import JSON

LINGER_S = 10.0
STALL_S = 30.0
"""How long a sender may pause in the midst of a body."""
UNPACK_STEP = 1 << 10
ZSTD_WINDOW = 1 << 23
"""What a receiver has to take at least, and a sender may use at most (RFC 9659); each body has one in memory."""
MAX_FORM_BYTES = 1 << 17
"""Largest form that is read at once; those with long columns are read by `forms`."""
FORM_COST = 32
"""Bytes of memory that each byte of a JSON form takes at most; its own included."""


class Unpacker:
    """Unpacks a stream of one or more members (gzip) or frames (zstd); `open_` opens the next one."""

    def __init__(self, open_: Callable[[], Any]) -> None:
        self._open = open_
        self._member = open_()

    @property
    def eof(self) -> bool:
        """Whether the last member was whole."""
        return bool(self._member.eof)

    def decompress(self, data: bytes) -> bytes:
        """What these packed bytes unpack to."""
        parts = []
        while data:
            if self._member.eof:
                self._member = self._open()
            parts.append(self._member.decompress(data))
            data = self._member.unused_data
        return b"".join(parts)


UNPACKERS: Mapping[str, Callable[[], Any]] = {
    "gzip": lambda: zlib.decompressobj(wbits=zlib.MAX_WBITS | 16),
    "zstd": lambda: zstandard.ZstdDecompressor(max_window_size=ZSTD_WINDOW).decompressobj(),
}


async def read_body(request: Request, limit: int, share: Share) -> bytearray:
    """The unpacked body, with `share` grown to its length.

    Raises BodyTooLargeError, BodyStalledError, TooManyBodiesError, UnreadableBodyError, UnsupportedMediaTypeError.
    A body that is too large is read to its end for a while and thrown away, so that its sender gets the answer
    instead of a broken connection.
    """
    unpacker = _unpacker(request)
    declared = _declared(request)
    if declared > limit:
        await _drain(request)
        raise BodyTooLargeError(limit)
    await share.grow(declared)
    content, more = bytearray(), True
    while more:
        data, more = await _receive(request)
        for part in _unpacked(unpacker, data):
            if len(content) + len(part) > limit:
                content.clear()
                if more:
                    await _drain(request)
                raise BodyTooLargeError(limit)
            if len(content) + len(part) > share.held:
                await share.grow(len(content) + len(part) - share.held)
            content += part
    if unpacker is not None and not unpacker.eof:
        raise UnreadableBodyError("The compressed body is cut short.")
    return content


def _declared(request: Request) -> int:
    """The length of the body as it is sent, 0 where that is not said."""
    declared = request.headers.get("content-length", "")
    return int(declared) if declared.isdigit() else 0


async def _receive(request: Request) -> tuple[bytes, bool]:
    """The next part of the body and whether there is more."""
    try:
        async with asyncio.timeout(STALL_S):
            message = await request.receive()
    except TimeoutError:
        raise BodyStalledError(STALL_S) from None
    if message["type"] != "http.request":
        raise UnreadableBodyError("The connection ended before the body did.")
    return message.get("body", b""), message.get("more_body", False)


def _unpacker(request: Request) -> Unpacker | None:
    encoding = request.headers.get("content-encoding", "identity").strip().lower()
    if encoding == "identity":
        return None
    if encoding not in UNPACKERS:
        raise UnsupportedMediaTypeError(f"Content-Encoding {encoding!r} is not read here; use gzip, zstd or none.")
    return Unpacker(UNPACKERS[encoding])


def _unpacked(unpacker: Unpacker | None, data: bytes) -> Iterator[bytes]:
    """Parts of the unpacked data; packed data goes in small steps, so that a bomb is noticed while it is small."""
    if unpacker is None:
        yield data
        return
    try:
        for start in range(0, len(data), UNPACK_STEP):
            yield unpacker.decompress(data[start : start + UNPACK_STEP])
    except (zlib.error, zstandard.ZstdError, EOFError) as error:
        raise UnreadableBodyError(f"The compressed body cannot be unpacked: {error}.") from None


async def _drain(request: Request) -> None:
    """Let the sender finish, but not for ever. One that waits for 'continue' has sent nothing."""
    deadline = time.monotonic() + LINGER_S
    more = request.headers.get("expect", "").lower() != "100-continue"
    while more and time.monotonic() < deadline:
        _, more = await _receive(request)


class FormRoute(StrictRoute):
    """A route whose JSON form is read as every other body: within the limit, unpacked, of a known media type.

    Of somebody without a key, where one is needed, nothing is read.
    """

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """The handler of a request whose body has been read."""
        handle = super().get_route_handler()
        if self.body_field is None:
            return handle

        async def handle_read(request: Request) -> Response:
            await run_in_threadpool(authenticate, request)
            with state_of(request).budget.share() as share:
                content = await read_body(request, MAX_FORM_BYTES, share)
                if content:
                    check_json(request)
                await share.grow(len(content) * (FORM_COST - 1))
                return await handle(Request(request.scope, _receiver(content, request.receive)))

        return handle_read


def check_json(request: Request) -> None:
    """Raises UnsupportedMediaTypeError where the body is not said to be JSON."""
    media_type = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if media_type != JSON:
        raise UnsupportedMediaTypeError(f"Content-Type {media_type!r} is not read here; send {JSON}.")


def _receiver(content: bytearray, after: Receive) -> Receive:
    """Gives a body that has been read already, and then what comes after it."""
    given = False

    async def receive() -> Message:
        nonlocal given
        if given:
            return await after()
        given = True
        return {"type": "http.request", "body": content, "more_body": False}

    return receive

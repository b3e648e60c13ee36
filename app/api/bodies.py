"""Bodies: read within a limit that counts unpacked bytes, gzip or zstd unpacked on the way."""

import time
import zlib
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import zstandard
from starlette.requests import Request

from app.errors import BodyTooLargeError, UnreadableBodyError, UnsupportedMediaTypeError

LINGER_S = 10.0
UNPACK_STEP = 1 << 10

UNPACKERS: Mapping[str, Callable[[], Any]] = {
    "gzip": lambda: zlib.decompressobj(wbits=zlib.MAX_WBITS | 16),
    "zstd": lambda: zstandard.ZstdDecompressor(max_window_size=1 << 27).decompressobj(),
}


async def read_body(request: Request, limit: int) -> bytes:
    """The unpacked body. Raises BodyTooLargeError, UnreadableBodyError, UnsupportedMediaTypeError.

    A body that is too large is read to its end for a while and thrown away, so that its sender gets the answer
    instead of a broken connection.
    """
    unpacker = _unpacker(request)
    declared = request.headers.get("content-length", "")
    if declared.isdigit() and int(declared) > limit:
        await _drain(request)
        raise BodyTooLargeError(limit)
    parts: list[bytes] = []
    size, more = 0, True
    while more:
        data, more = await _receive(request)
        for part in _unpacked(unpacker, data):
            size += len(part)
            if size > limit:
                parts.clear()
                if more:
                    await _drain(request)
                raise BodyTooLargeError(limit)
            parts.append(part)
    if unpacker is not None and size and not unpacker.eof:
        raise UnreadableBodyError("The compressed body is cut short.")
    return b"".join(parts)


async def _receive(request: Request) -> tuple[bytes, bool]:
    """The next part of the body and whether there is more."""
    message = await request.receive()
    if message["type"] != "http.request":
        raise UnreadableBodyError("The connection ended before the body did.")
    return message.get("body", b""), message.get("more_body", False)


def _unpacker(request: Request) -> Any:
    encoding = request.headers.get("content-encoding", "identity").strip().lower()
    if encoding == "identity":
        return None
    if encoding not in UNPACKERS:
        raise UnsupportedMediaTypeError(f"Content-Encoding {encoding!r} is not read here; use gzip, zstd or none.")
    return UNPACKERS[encoding]()


def _unpacked(unpacker: Any, data: bytes) -> Iterator[bytes]:
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

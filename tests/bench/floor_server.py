"""The least a server can do, under the same uvicorn: `python -m tests.bench.floor_server`.

A POST is read to its end and answered with an empty 201; `GET /N` is answered with N bytes from memory. It prints its
port once it listens.
"""

import socket
from collections.abc import Awaitable, Callable
from functools import cache
from typing import Any

import uvicorn

from web.serve import configure

Receive = Callable[[], Awaitable[dict[str, Any]]]
Send = Callable[[dict[str, Any]], Awaitable[None]]


async def floor(scope: dict[str, Any], receive: Receive, send: Send) -> None:
    """The ASGI application."""
    if scope["type"] != "http":
        return
    parts = []
    more = True
    while more:
        message = await receive()
        parts.append(message.get("body", b""))
        more = message.get("more_body", False)
    b"".join(parts)
    content = zeros(int(scope["path"].strip("/") or 0)) if scope["method"] == "GET" else b""
    headers = [(b"content-length", str(len(content)).encode())]
    await send({"type": "http.response.start", "status": 201, "headers": headers})
    await send({"type": "http.response.body", "body": content})


@cache
def zeros(size: int) -> bytes:
    """Always the same bytes."""
    return bytes(size)


def main() -> None:
    bound = socket.create_server(("127.0.0.1", 0))
    print(bound.getsockname()[1], flush=True)
    uvicorn.Server(configure(floor, "127.0.0.1", 0)).run([bound])


if __name__ == "__main__":
    main()

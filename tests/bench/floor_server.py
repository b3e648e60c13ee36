"""The least a server can do, under the same uvicorn: `python -m tests.bench.floor_server bare` or `site`.

`bare`: a POST is read to its end and answered with an empty 201, `GET /N` with N bytes from memory, by one ASGI
function. `site`: `POST /floor` likewise, by a route of the site with all that stands before its routes. It prints its
port once it listens.
"""

import socket
import sys
from collections.abc import Awaitable, Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import cache
from typing import Any

import uvicorn
from fastapi import Request, Response

from tests.bench import databases
from tests.support.contexts import opened
from tidemap.server.census import Census
from tidemap.server.processes import all_in_one
from tidemap.server.serving import SWITCH_S, configure
from tidemap_web.site import pages

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
    content = memory(int(scope["path"].strip("/") or 0)) if scope["method"] == "GET" else b""
    headers = [(b"content-length", str(len(content)).encode())]
    await send({"type": "http.response.start", "status": 201, "headers": headers})
    await send({"type": "http.response.body", "body": content})


@cache
def memory(size: int) -> bytes:
    """Always the same bytes. Zeros would be one page of the system's again and again, which costs less to read."""
    return b"\x01" * size


@contextmanager
def bare() -> Iterator[Any]:
    """The ASGI function alone."""
    yield floor


@contextmanager
def site() -> Iterator[Any]:
    """The site on an empty database, as the figure's server has it, with one route more."""
    with databases.sqlite() as url, opened(url, viewer=False) as ctx, all_in_one(ctx, pages) as application:
        application.add_api_route("/floor", empty, methods=["POST"])
        yield application


async def empty(request: Request) -> Response:
    """Read the body, answer 201."""
    await request.body()
    return Response(status_code=201)


APPLICATIONS: dict[str, Callable[[], AbstractContextManager[Any]]] = {"bare": bare, "site": site}


def main(name: str) -> None:
    sys.setswitchinterval(SWITCH_S)
    bound = socket.create_server(("127.0.0.1", 0))
    with APPLICATIONS[name]() as application:
        print(bound.getsockname()[1], flush=True)
        uvicorn.Server(configure(application, "127.0.0.1", 0, Census(1000, 1000))).run([bound])


if __name__ == "__main__":
    main(sys.argv[1])

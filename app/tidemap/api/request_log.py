"""Request ids, in every line of the log and in every answer, and the access log."""

import logging
import re
import secrets
import time

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from tidemap.log import request_id

HEADER = b"x-request-id"
_GIVEN = re.compile(rb"[A-Za-z0-9._-]{1,64}")
access = logging.getLogger("tidemap.access")


class RequestLog:
    """ASGI middleware: keeps the id that a proxy gave to a request, or gives it one.

    With `access_log` there is a line for each request when it is answered, and for each socket when it is closed:
    method, path without query, status, time, address. No header and no body is logged.
    """

    def __init__(self, app: ASGIApp, access_log: bool) -> None:
        self._app = app
        self._access_log = access_log

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        given = next((value for name, value in scope["headers"] if name == HEADER), b"")
        known = given if _GIVEN.fullmatch(given) else secrets.token_hex(8).encode()
        status, began = 0, time.perf_counter()

        async def named(message: Message) -> None:
            nonlocal status
            if message["type"] in ("http.response.start", "websocket.http.response.start", "websocket.accept"):
                status = message.get("status", 101)
                message["headers"] = [*message.get("headers", ()), (HEADER, known)]
            await send(message)

        token = request_id.set(known.decode())
        try:
            await self._app(scope, receive, named)
        finally:
            if self._access_log:
                _note(scope, status, time.perf_counter() - began)
            request_id.reset(token)


def _note(scope: Scope, status: int, seconds: float) -> None:
    facts = {
        "method": scope.get("method", "WEBSOCKET"),
        "path": scope["path"],
        "status": status,
        "ms": round(seconds * 1e3, 1),
        "client": scope["client"][0] if scope.get("client") else "",
    }
    access.info("%(method)s %(path)s %(status)d %(ms).1f ms from %(client)s", facts, extra={"facts": facts})

"""Unchanged: who asks again for a list of events that is as it was is answered 304 before it is routed or read."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from cachetools import LRUCache
from starlette.datastructures import Headers
from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from tidemap.api.addresses import BASE
from tidemap.api.auth import bearer, readmit
from tidemap.api.encoding import etag_headers, holds
from tidemap.errors import DomainError
from tidemap.events.bus import Bus
from tidemap.events.subscription import EventFilter, listen
from tidemap.services.keys import OPEN, Principal, digest_of
from tidemap.storage.changes import Changes

LIST = "/anomalies"
"""How the paths of lists of events end. They depend on nothing but the query, who asks and what is stored."""
KNOWN = frozenset({200, 304})
MAX_ANSWERS = 1024
MAX_QUERY_BYTES = 1024
BELIEVED_S = 1.0
"""How long an answer stands where what other processes store is heard of alone: some of it makes no message."""
COUNTED = EventFilter(kinds=frozenset({"anomaly", "location", "attention"}))

Question = tuple[str, bytes, bytes | None]
"""Path, query, and the hash of the secret that is sent as a header."""


@dataclass(frozen=True, slots=True, eq=False)
class _Known:
    """The version that an asker was given; it stands as long as the number of changes is this one."""

    number: int
    until: float
    principal: Principal
    etag: str
    route: Any


class Unchanged:
    """ASGI middleware over lists of events; within it is what counts, names and logs requests, as they all are.

    Who asks is known from the request that made the answer, and that nothing stored of keys has changed since; expiry,
    the rate and pages of other sites are checked every time. Browser sessions, which end by themselves, are looked up.
    `hears`: whether it is heard of what other processes store.
    """

    def __init__(
        self, app: ASGIApp, changes: Changes, hears: Callable[[], bool], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._app = app
        self._changes = changes
        self._hears = hears
        self._clock = clock
        self._known: LRUCache[Question, _Known] = LRUCache(MAX_ANSWERS)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or scope["method"] != "GET" or not scope["path"].endswith(LIST):
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        # Before the key is looked up: what is revoked meanwhile is not taken for what was asked after that.
        number = self._number() if "if-none-match" in headers and scope["path"].startswith(BASE) else None
        if number is None or len(scope["query_string"]) > MAX_QUERY_BYTES:
            await self._app(scope, receive, send)
            return
        question, now = _question(scope), self._clock()
        known = self._known.get(question)
        if known is None or known.number != number or now >= known.until or not _stands(scope, headers, known):
            await self._app(scope, receive, self._noting(scope, question, number, send))
            return
        scope["route"] = known.route
        raw = [(name.lower().encode(), value.encode()) for name, value in etag_headers(known.etag).items()]
        await send({"type": "http.response.start", "status": 304, "headers": raw})
        await send({"type": "http.response.body", "body": b""})

    def _number(self) -> int | None:
        """The number of changes; None where it cannot be known."""
        return self._changes.number() if self._changes.exact or self._hears() else None

    def _noting(self, scope: Scope, question: Question, number: int, send: Send) -> Send:
        """Sends, and takes note of the version that is sent."""
        until = math.inf if self._changes.exact else self._clock() + BELIEVED_S

        async def note(message: Message) -> None:
            if message["type"] == "http.response.start" and message["status"] in KNOWN:
                etag, route = Headers(raw=message["headers"]).get("etag"), scope["route"]
                principal = scope["state"]["principal"]
                if etag is not None and route.path.endswith(LIST) and (question[2] is not None or principal == OPEN):
                    self._known[question] = _Known(number, until, principal, etag.removeprefix("W/"), route)
            await send(message)

        return note


def hear_of_changes(bus: Bus, changes: Changes) -> None:
    """Have what other processes say they stored count from now on, where it is not known at once."""
    if not changes.exact:
        listen(bus, COUNTED, lambda _: changes.note())


def _question(scope: Scope) -> Question:
    secret = bearer(HTTPConnection(scope))
    return scope["path"], scope["query_string"], None if secret is None else digest_of(secret)


def _stands(scope: Scope, headers: Headers, known: _Known) -> bool:
    """Whether the asker holds what is known and may ask. Who may not is refused, in words, where that is said."""
    if not holds(headers, known.etag):
        return False
    try:
        readmit(HTTPConnection(scope), known.principal)
    except DomainError:
        return False
    return True

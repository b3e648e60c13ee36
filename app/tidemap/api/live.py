"""The WebSocket /events: messages as they happen, anomalies that were missed first, slow readers dropped."""

import asyncio
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from typing import get_args

import orjson
from fastapi import APIRouter, WebSocket
from starlette.concurrency import run_in_threadpool
from starlette.websockets import WebSocketDisconnect, WebSocketState

from tidemap.api.auth import ENDED, authenticate, until_ended
from tidemap.api.dependencies import cursor
from tidemap.api.errors import domain_response
from tidemap.api.parameters import refuse_unknown
from tidemap.api.state import state_of
from tidemap.errors import DomainError, ForbiddenError, InvalidInputError
from tidemap.events.messages import EventMessage, Kind
from tidemap.services.anomalies import EventQuery, list_events
from tidemap.services.context import Context
from tidemap.services.keys import allows
from tidemap.services.locations import find_location
from tidemap.services.observe import anomaly_message

router = APIRouter()
TOO_SLOW = 1013
CLOSE_S = 2.0
REPLAY_PAGE = 500


@dataclass(frozen=True, slots=True)
class EventFilter:
    """What a reader wants to hear; `after` is the last anomaly it has seen."""

    location: str | None
    kinds: frozenset[str]
    after: int | None

    def wants(self, message: EventMessage) -> bool:
        """Whether this message is for the reader."""
        return message.kind in self.kinds and self.location in (None, message.location)


class Backlog:
    """Messages that wait for one reader, at most `limit`; `overflowed` once there were more."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._waiting: deque[EventMessage] = deque()
        self._filled = asyncio.Event()
        self.overflowed = asyncio.Event()

    def put(self, message: EventMessage) -> None:
        """In the reader's event loop."""
        if len(self._waiting) >= self._limit:
            self._waiting.clear()
            self.overflowed.set()
        elif not self.overflowed.is_set():
            self._waiting.append(message)
            self._filled.set()

    async def get(self) -> EventMessage:
        """The next message, when there is one."""
        while not self._waiting:
            self._filled.clear()
            await self._filled.wait()
        return self._waiting.popleft()


@router.websocket("/events")
async def events(socket: WebSocket) -> None:
    """Stream messages to one reader until either side ends it."""
    ctx: Context = state_of(socket).ctx
    try:
        wanted = await run_in_threadpool(_wanted, ctx, socket)
    except DomainError as error:
        await socket.send_denial_response(domain_response(socket.url.path, error))
        return
    loop = asyncio.get_running_loop()
    backlog = Backlog(ctx.settings.socket_queue)

    def listen(message: EventMessage) -> None:
        if wanted.wants(message):
            loop.call_soon_threadsafe(backlog.put, message)

    unsubscribe = ctx.bus.subscribe(listen)
    try:
        await socket.accept()
        await _stream(ctx, socket, wanted, backlog)
    finally:
        unsubscribe()


def _wanted(ctx: Context, socket: WebSocket) -> EventFilter:
    """What the reader asks for.

    Raises UnauthorizedError, ForbiddenError, OtherSiteError, RateLimitError, InvalidInputError, LocationNotFoundError.
    """
    principal = authenticate(socket)
    if not allows(principal.role, "operator"):
        raise ForbiddenError(f"The key {principal.name!r} has role {principal.role}; events need operator or admin.")
    query = socket.query_params
    refuse_unknown(query, ("location", "kind", "after"))
    known = get_args(Kind)
    asked = [kind for value in query.getlist("kind") for part in value.split("|") for kind in part.split(",") if kind]
    for kind in asked:
        if kind not in known:
            raise InvalidInputError.at("kind", f"{kind!r} is none of {', '.join(known)}")
    location = query.get("location")
    if location is not None:
        find_location(ctx, location)
    return EventFilter(location, frozenset(asked or known), cursor("after", query.get("after")))


async def _stream(ctx: Context, socket: WebSocket, wanted: EventFilter, backlog: Backlog) -> None:
    sender = asyncio.create_task(_send(ctx, socket, wanted, backlog))
    ended = asyncio.create_task(until_ended(socket))
    tasks = [sender, ended, asyncio.create_task(_until_gone(socket)), asyncio.create_task(backlog.overflowed.wait())]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        code, reason = _why(backlog, ended)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    if socket.application_state is not WebSocketState.CONNECTED or socket.client_state is not WebSocketState.CONNECTED:
        return
    with suppress(TimeoutError, RuntimeError, WebSocketDisconnect):
        await asyncio.wait_for(socket.close(code, reason), CLOSE_S)


def _why(backlog: Backlog, ended: asyncio.Task[None]) -> tuple[int, str]:
    """The code and reason to close with."""
    if backlog.overflowed.is_set():
        return TOO_SLOW, "too slow; resume with ?after="
    return ENDED if ended.done() else (1011, "failed")


async def _send(ctx: Context, socket: WebSocket, wanted: EventFilter, backlog: Backlog) -> None:
    replayed = await _replay(ctx, socket, wanted)
    while True:
        message = await backlog.get()
        if message.kind != "anomaly" or message.id > replayed:
            await _send_one(socket, message)


async def _replay(ctx: Context, socket: WebSocket, wanted: EventFilter) -> int:
    """Send the anomalies since `after`; the id of the last."""
    last = wanted.after
    if last is None or "anomaly" not in wanted.kinds:
        return 0
    while True:
        query = EventQuery(location=wanted.location, after=last, limit=REPLAY_PAGE)
        missed = await run_in_threadpool(list_events, ctx, query)
        for event in missed:
            message = anomaly_message(event, ctx.clock())
            last = message.id
            await _send_one(socket, message)
        if len(missed) < REPLAY_PAGE:
            return last


async def _send_one(socket: WebSocket, message: EventMessage) -> None:
    await socket.send_text(orjson.dumps(message.wire()).decode())


async def _until_gone(socket: WebSocket) -> None:
    """Ends when the reader does; what it says is not listened to."""
    while (await socket.receive())["type"] != "websocket.disconnect":
        pass

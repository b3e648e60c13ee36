"""The WebSocket /events: messages as they happen, anomalies that were missed first, slow readers dropped."""

import asyncio
from contextlib import suppress
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
from tidemap.events.subscription import KINDS, EventFilter, EventStream
from tidemap.services.context import Context
from tidemap.services.keys import allows
from tidemap.services.locations import find_location
from tidemap.services.messages import missed_anomalies

router = APIRouter()
TOO_SLOW = 1013
CLOSE_S = 2.0


@router.websocket("/events")
async def events(socket: WebSocket) -> None:
    """Stream messages to one reader until either side ends it."""
    ctx: Context = state_of(socket).ctx
    try:
        wanted = await run_in_threadpool(_wanted, ctx, socket)
    except DomainError as error:
        await socket.send_denial_response(domain_response(socket.url.path, error))
        return

    async def missed(after: int, limit: int) -> list[EventMessage]:
        return await run_in_threadpool(missed_anomalies, ctx, wanted.location, after, limit)

    with EventStream(ctx.bus, wanted, ctx.settings.socket_queue, missed) as stream:
        await socket.accept()
        await _serve(socket, stream)


def _wanted(ctx: Context, socket: WebSocket) -> EventFilter:
    """What the reader asks for.

    Raises UnauthorizedError, ForbiddenError, OtherSiteError, RateLimitError, InvalidInputError, LocationNotFoundError.
    """
    principal = authenticate(socket)
    if not allows(principal.role, "operator"):
        raise ForbiddenError(f"The key {principal.name!r} has role {principal.role}; events need operator or admin.")
    query = socket.query_params
    refuse_unknown(query, ("location", "kind", "after"))
    asked = [kind for value in query.getlist("kind") for part in value.split("|") for kind in part.split(",") if kind]
    for kind in asked:
        if kind not in KINDS:
            raise InvalidInputError.at("kind", f"{kind!r} is none of {', '.join(get_args(Kind))}")
    location = query.get("location")
    if location is not None:
        find_location(ctx, location)
    return EventFilter(location, frozenset(asked) or KINDS, cursor("after", query.get("after")))


async def _serve(socket: WebSocket, stream: EventStream) -> None:
    """Send until the reader leaves, is too slow, or may not listen any more; close the socket if it is open still."""
    ended = asyncio.create_task(until_ended(socket))
    others = (_send(socket, stream), _until_gone(socket), stream.overflowed.wait())
    tasks = [ended, *(asyncio.create_task(each) for each in others)]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        code, reason = _why(stream, ended)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    if socket.application_state is not WebSocketState.CONNECTED or socket.client_state is not WebSocketState.CONNECTED:
        return
    with suppress(TimeoutError, RuntimeError, WebSocketDisconnect):
        await asyncio.wait_for(socket.close(code, reason), CLOSE_S)


def _why(stream: EventStream, ended: asyncio.Task[None]) -> tuple[int, str]:
    """The code and reason to close with."""
    if stream.overflowed.is_set():
        return TOO_SLOW, "too slow; resume with ?after="
    return ENDED if ended.done() else (1011, "failed")


async def _send(socket: WebSocket, stream: EventStream) -> None:
    async for message in stream:
        await socket.send_text(orjson.dumps(message.wire()).decode())


async def _until_gone(socket: WebSocket) -> None:
    """Ends when the reader does; what it says is not listened to."""
    while (await socket.receive())["type"] != "websocket.disconnect":
        pass

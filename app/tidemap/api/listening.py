"""Listening to events: who may, from where on, and when it ends. WebSocket and Server-Sent Events share all of it."""

import asyncio
from collections.abc import AsyncIterator, Coroutine, Sequence
from contextlib import asynccontextmanager
from enum import Enum, auto
from typing import Any, get_args

from starlette.concurrency import run_in_threadpool
from starlette.requests import HTTPConnection

from tidemap.api.auth import authenticate, until_ended
from tidemap.api.dependencies import cursor
from tidemap.api.scopes import check_name
from tidemap.api.state import state_of
from tidemap.errors import ForbiddenError, InvalidInputError
from tidemap.events.messages import EventMessage, Kind
from tidemap.events.subscription import KINDS, EventFilter, EventStream
from tidemap.services.context import Context
from tidemap.services.keys import allows
from tidemap.services.locations import find_location
from tidemap.services.messages import latest_change, missed_changes

POSITION = "Last-Event-ID"
"""The header that names the last change of an anomaly before the first message, so that a reader can resume before it
has any."""

REST_S = 0.05
"""After each time that something was sent a reader rests so long, and then gets all that has come meanwhile at once."""


class End(Enum):
    """Why a reader hears no more."""

    LEFT = auto()
    """Its connection has gone, or sending to it failed."""
    TOO_SLOW = auto()
    NOT_ALLOWED = auto()
    """Its key or session has ended."""


def wanted_events(
    connection: HTTPConnection, location: str | None, kinds: Sequence[str], after: str | None
) -> EventFilter:
    """What a reader asks for. Without `after` it is the anomalies from now on: the filter names the last change so far.

    Raises UnauthorizedError, ForbiddenError, OtherSiteError, RateLimitError, InvalidInputError, LocationNotFoundError.
    """
    ctx, principal = state_of(connection).ctx, authenticate(connection)
    if not allows(principal.role, "operator"):
        raise ForbiddenError(f"The key {principal.name!r} has role {principal.role}; events need operator or admin.")
    asked = [kind for value in kinds for part in value.split("|") for kind in part.split(",") if kind]
    for kind in asked:
        if kind not in KINDS:
            raise InvalidInputError.at("kind", f"{kind!r} is none of {', '.join(get_args(Kind))}")
    if location is not None:
        check_name(principal, location)
        find_location(ctx, location)
    known = cursor("after", after)
    latest = latest_change(ctx)
    # A database that was restored counts from an earlier number than a reader may have seen.
    resume_from = latest if known is None else min(known, latest)
    return EventFilter(location, frozenset(asked) or KINDS, resume_from, principal.scope)


@asynccontextmanager
async def listening(connection: HTTPConnection, wanted: EventFilter, transport: str) -> AsyncIterator[EventStream]:
    """The messages for one reader, who is counted among the listeners meanwhile."""
    state = state_of(connection)
    ctx: Context = state.ctx

    async def missed(after: int, limit: int) -> list[EventMessage]:
        return await run_in_threadpool(missed_changes, ctx, wanted, after, limit)

    limit, lag = ctx.settings.socket_queue, state.listeners.lag(transport)
    with state.listeners.count(transport), EventStream(ctx.bus, wanted, limit, missed, lag) as stream:
        yield stream
        if stream.overflowed.is_set():
            state.listeners.drop(transport)


async def serve(connection: HTTPConnection, stream: EventStream, *carrying: Coroutine[Any, Any, object]) -> End:
    """Run what carries messages to a reader until the first of it ends, the reader is too slow or may hear no more."""
    ended = asyncio.create_task(until_ended(connection))
    tasks = [ended, *(asyncio.create_task(each) for each in (stream.overflowed.wait(), *carrying))]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        if stream.overflowed.is_set():
            return End.TOO_SLOW
        return End.NOT_ALLOWED if ended.done() else End.LEFT
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

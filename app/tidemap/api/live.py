"""The WebSocket /events: messages as they happen, anomalies that were missed first, slow readers dropped."""

import asyncio
from contextlib import suppress

from fastapi import APIRouter, WebSocket
from starlette.concurrency import run_in_threadpool
from starlette.websockets import WebSocketDisconnect, WebSocketState

from tidemap.api.auth import ENDED, authenticate
from tidemap.api.connections import bound_buffer, sender_of
from tidemap.api.errors import domain_response
from tidemap.api.listening import POSITION, REST_S, End, listening, serve, wanted_events
from tidemap.api.parameters import refuse_unknown
from tidemap.errors import DomainError
from tidemap.events.subscription import EventFilter, EventStream

router = APIRouter()
CLOSE_S = 2.0
CLOSES = {
    End.TOO_SLOW: (1013, "too slow; resume with ?after="),
    End.NOT_ALLOWED: ENDED,
    End.LEFT: (1011, "failed"),
}


@router.websocket("/events")
async def events(socket: WebSocket) -> None:
    """Stream messages to one reader until either side ends it."""
    try:
        wanted = await run_in_threadpool(_wanted, socket)
    except DomainError as error:
        await socket.send_denial_response(domain_response(socket.url.path, error))
        return
    bound_buffer(socket.scope)
    async with listening(socket, wanted, "websocket") as stream:
        await socket.accept(headers=[(POSITION.lower().encode(), str(wanted.after).encode())])
        end = await serve(socket, stream, _send(socket, stream), _until_gone(socket))
        await _close(socket, *CLOSES[end])


def _wanted(socket: WebSocket) -> EventFilter:
    """Raises as `wanted_events`."""
    query = socket.query_params
    authenticate(socket)
    refuse_unknown(query, ("location", "kind", "after"))
    return wanted_events(socket, query.get("location"), query.getlist("kind"), query.get("after"))


async def _close(socket: WebSocket, code: int, reason: str) -> None:
    """Close the socket if it is open still."""
    if socket.application_state is not WebSocketState.CONNECTED or socket.client_state is not WebSocketState.CONNECTED:
        return
    with suppress(TimeoutError, RuntimeError, WebSocketDisconnect):
        await asyncio.wait_for(socket.close(code, reason), CLOSE_S)


async def _send(socket: WebSocket, stream: EventStream) -> None:
    send = sender_of(socket)
    async for message in stream:
        await send([each.encoded for each in (message, *stream.at_hand())])
        await asyncio.sleep(REST_S)


async def _until_gone(socket: WebSocket) -> None:
    """Ends when the reader does; what it says is not listened to."""
    while (await socket.receive())["type"] != "websocket.disconnect":
        pass

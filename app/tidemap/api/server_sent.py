"""Server-Sent Events: an answer that goes on, one text block a message (WHATWG HTML, section 9.2)."""

import asyncio
from contextlib import suppress

from starlette.requests import Request
from starlette.responses import Response
from starlette.types import Message, Receive, Scope, Send

from tidemap.api.connections import abort, bound_buffer
from tidemap.api.listening import POSITION, REST_S, End, listening, serve
from tidemap.api.state import state_of
from tidemap.events.messages import EventMessage
from tidemap.events.subscription import EventFilter, EventStream
from tidemap.media_types import EVENT_STREAM

HEARTBEAT_S = 10.0
"""After so long without a message comes a comment: proxies end what is silent for a minute, or for half of one."""
RETRY_MS = 2000
STOP_POLL_S = 0.5
"""How often to look whether the server stops."""
END_S = 2.0
"""How long the end of the answer may wait for the reader."""
LAST: Message = {"type": "http.response.body", "body": b""}


class ServerSentEvents(Response):
    """The messages that somebody wants, until they leave, are too slow, may hear no more, or the server stops."""

    media_type = EVENT_STREAM

    def __init__(self, request: Request, wanted: EventFilter) -> None:
        # Proxies are not to collect what is sent: nginx does unless told.
        headers = {"Cache-Control": "private, no-store", "X-Accel-Buffering": "no", POSITION: str(wanted.after)}
        super().__init__(None, headers=headers)
        del self.headers["content-length"]
        self._request = request
        self._wanted = wanted

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send until it ends."""
        bound_buffer(scope)
        async with listening(self._request, self._wanted, "sse") as stream:
            await send({"type": "http.response.start", "status": 200, "headers": self.raw_headers})
            carrying = self._send(stream, send), _until_gone(receive), self._until_stopping()
            if await serve(self._request, stream, *carrying) is End.TOO_SLOW:
                abort(scope)
            try:
                await asyncio.wait_for(send(LAST), END_S)
            except TimeoutError:
                abort(scope)
                # It waits until the connection has gone.
                with suppress(TimeoutError):
                    await asyncio.wait_for(send(LAST), END_S)

    async def _send(self, stream: EventStream, send: Send) -> None:
        await _write(send, f"retry: {RETRY_MS}\nid: {self._wanted.after}\n\n".encode())
        while True:
            try:
                async with asyncio.timeout(HEARTBEAT_S):
                    first = await anext(stream)
                block = b"".join(map(block_of, (first, *stream.at_hand())))
            except TimeoutError:
                block = b": still here\n\n"
            await _write(send, block)
            await asyncio.sleep(REST_S)

    async def _until_stopping(self) -> None:
        stopping = state_of(self._request).stopping
        while not stopping.is_set():
            await asyncio.sleep(STOP_POLL_S)


def block_of(message: EventMessage) -> bytes:
    """A message as a block of the stream; the number of an anomaly's change is the point to resume from.

    >>> block_of(EventMessage("anomaly", "lab", 7, 0.0, {"change": 9}))
    b'id: 9\\ndata: {"change":9,"kind":"anomaly","location":"lab","id":7,"time":"1970-01-01T00:00:00Z"}\\n\\n'
    """
    head = b"id: %d\n" % message.position if message.kind == "anomaly" else b""
    return head + b"data: " + message.encoded + b"\n\n"


async def _write(send: Send, block: bytes) -> None:
    await send({"type": "http.response.body", "body": block, "more_body": True})


async def _until_gone(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass

"""What our server lets a route do with its connection, as ASGI extensions; under another server they do nothing."""

from collections.abc import Awaitable, Callable, Sequence

from starlette.types import Scope
from starlette.websockets import WebSocket

ABORT = "tidemap.abort"
"""Ends a connection without waiting for its reader."""
BOUND_BUFFER = "tidemap.bound_buffer"
"""Has the system hold few bytes for the reader, so that one who does not keep up is noticed soon."""
SEND_TEXTS = "tidemap.send_texts"
"""Sends many messages of a WebSocket, encoded already, in one write."""

SendTexts = Callable[[Sequence[bytes]], Awaitable[None]]


def abort(scope: Scope) -> None:
    """End the connection of a reader that is stuck: what waits for it would wait for ever."""
    _call(scope, ABORT)


def bound_buffer(scope: Scope) -> None:
    """Let few bytes wait in the system for the reader of a connection."""
    _call(scope, BOUND_BUFFER)


def sender_of(socket: WebSocket) -> SendTexts:
    """What sends many text messages at once."""
    found: SendTexts | None = socket.scope.get("extensions", {}).get(SEND_TEXTS)
    if found is not None:
        return found

    async def send(texts: Sequence[bytes]) -> None:
        for text in texts:
            await socket.send_text(text.decode())

    return send


def _call(scope: Scope, extension: str) -> None:
    run: Callable[[], None] | None = scope.get("extensions", {}).get(extension)
    if run is not None:
        run()

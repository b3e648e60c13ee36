"""Ending a connection whose reader is stuck: what waits for it would wait for ever."""

from collections.abc import Callable

from starlette.types import Scope

ABORT = "tidemap.abort"
"""The ASGI extension that ends a connection without waiting for its reader."""


def abort(scope: Scope) -> None:
    """End the connection of a request, where the server can."""
    end: Callable[[], None] | None = scope.get("extensions", {}).get(ABORT)
    if end is not None:
        end()

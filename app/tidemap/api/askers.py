"""Askers: whether who asked still waits for the answer."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from threading import Event

from starlette.requests import Request


@asynccontextmanager
async def asker_left(request: Request) -> AsyncIterator[Event]:
    """An event that is set when the asker closes the connection, and when the block ends. Read the body first."""
    left = Event()

    async def watch() -> None:
        while (await request.receive())["type"] != "http.disconnect":
            pass
        left.set()

    watcher = asyncio.create_task(watch())
    try:
        yield left
    finally:
        # Also where the task of the block is cancelled: a thread of it is not.
        left.set()
        watcher.cancel()

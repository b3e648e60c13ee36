"""The outbox of an asynchronous client."""

import asyncio
import time
from pathlib import Path

from tidemap.client.outbox.blocking import GLANCE_S, Outbox
from tidemap.client.outbox.store import Pending, Refused


class AsyncOutbox:
    """`Outbox`, awaited.

    A thread sends here too: it goes on while the event loop is busy, and a commit to the disk needs one anyway.
    """

    def __init__(self, outbox: Outbox) -> None:
        self._outbox = outbox

    def __repr__(self) -> str:
        return f"AsyncOutbox({str(self.path)!r})"

    @property
    def path(self) -> Path:
        """The file."""
        return self._outbox.path

    @property
    def pending(self) -> Pending:
        """How much is still to be sent."""
        return self._outbox.pending

    async def flush(self, timeout_s: float | None = None) -> bool:
        """Wait until everything was sent, or refused; False if `timeout_s` was too short. Cuts pauses short."""
        deadline = self._outbox.hurry(timeout_s)
        while self.pending.batches:
            if time.monotonic() >= deadline:
                return False
            await asyncio.sleep(GLANCE_S)
        return True

    async def refused(self) -> list[Refused]:
        """What the server has refused for good, oldest first."""
        return await asyncio.to_thread(self._outbox.refused)

    async def retry(self, number: int) -> None:
        """Send a refused batch again, before all later ones of its location. Raises OutboxError if there is none."""
        await asyncio.to_thread(self._outbox.retry, number)

    async def move(self, number: int, location: str) -> None:
        """Send a refused batch to the location of this name. Raises OutboxError if there is none."""
        await asyncio.to_thread(self._outbox.move, number, location)

    async def discard(self, number: int) -> None:
        """Throw a refused batch away. Raises OutboxError if there is none."""
        await asyncio.to_thread(self._outbox.discard, number)

"""A request whose sender leaves when a test says so."""

import asyncio
from threading import Event
from types import SimpleNamespace
from typing import Any

from anyio import CapacityLimiter


class Asker:
    """A request whose sender leaves when `left` is set; `state` is what requests share."""

    def __init__(self, **state: Any) -> None:
        self.left = asyncio.Event()
        self.state: Any = SimpleNamespace(stopping=Event(), long_questions=CapacityLimiter(1), **state)
        self.app: Any = SimpleNamespace(state=SimpleNamespace(tidemap=self.state))
        self._messages = [{"type": "http.request", "body": b"", "more_body": False}]

    async def receive(self) -> dict[str, Any]:
        """The request, and then that its sender has left."""
        if self._messages:
            return self._messages.pop()
        await self.left.wait()
        return {"type": "http.disconnect"}

"""Long questions: answered in a thread, a few at a time, for as long as somebody waits for the answer."""

from collections.abc import Callable
from typing import TypeVar

import anyio.to_thread
from starlette.requests import Request

from tidemap.api.askers import asker_left
from tidemap.api.state import state_of
from tidemap.errors import AskerLeftError, ShuttingDownError

Result = TypeVar("Result")
Check = Callable[[], None]
"""Raises where the work is to end: called between two blocks of it."""


async def answered(request: Request, work: Callable[[Check], Result]) -> Result:
    """What `work` returns, which calls its argument between two blocks of some milliseconds.

    It ends soon after the asker has left (AskerLeftError) or the server stops (ShuttingDownError). Read the body first.
    """
    state = state_of(request)
    async with asker_left(request) as left:

        def check() -> None:
            if state.stopping.is_set():
                raise ShuttingDownError
            if left.is_set():
                raise AskerLeftError

        def begin() -> Result:
            check()
            return work(check)

        return await anyio.to_thread.run_sync(begin, limiter=state.long_questions)

"""An answer keeps its memory of the budget until it is sent, and no longer."""

import asyncio
from contextlib import ExitStack

import pytest
from starlette.types import Message

from tidemap.api.budget import Budget
from tidemap.api.connections import ABORT
from tidemap.api.encoding import PIECE_BYTES, LeasedResponse

SIZE = 3 * PIECE_BYTES + 1


async def leased(budget: Budget) -> LeasedResponse:
    """An answer of SIZE bytes, which holds as many."""
    stack = ExitStack()
    share = stack.enter_context(budget.share())
    await share.grow(SIZE)
    return LeasedResponse(b"x" * SIZE, "application/x-npy", stack)


async def receive() -> Message:
    raise AssertionError("nothing is read")


def test_it_is_given_back_when_the_last_part_is_sent() -> None:
    async def run() -> None:
        budget = Budget(8 * SIZE)
        response = await leased(budget)
        sent: list[Message] = []
        held: list[int] = []

        async def send(message: Message) -> None:
            held.append(budget.held)
            sent.append(message)

        await response({"type": "http"}, receive, send)
        assert b"".join(message.get("body", b"") for message in sent) == b"x" * SIZE
        assert max(len(message.get("body", b"")) for message in sent) == PIECE_BYTES
        assert not sent[-1].get("more_body", False)
        assert set(held) == {SIZE}
        assert budget.held == 0

    asyncio.run(run())


def test_a_reader_that_is_stuck_is_cut_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tidemap.api.encoding.MAX_STALL_S", 0.01)

    async def run() -> None:
        budget = Budget(8 * SIZE)
        response = await leased(budget)
        gone = asyncio.Event()

        async def send(message: Message) -> None:
            if message.get("body"):
                await asyncio.Event().wait()

        await response({"type": "http", "extensions": {ABORT: gone.set}}, receive, send)
        assert gone.is_set()
        assert budget.held == 0

    asyncio.run(run())

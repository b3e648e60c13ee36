"""Long questions end when nobody waits for their answer."""

import asyncio
from threading import Event
from typing import Any

import pytest

from tests.support.askers import Asker
from tests.support.waiting import WAIT_S
from tidemap.api.long_questions import Check, answered
from tidemap.errors import AskerLeftError, ShuttingDownError


def endless(begun: Event) -> Any:
    """Work that only its check ends."""

    def work(check: Check) -> None:
        begun.set()
        while True:
            check()

    return work


async def _ended_by(end: Any) -> None:
    asker, begun = Asker(), Event()
    answer = asyncio.create_task(answered(asker, endless(begun)))  # type: ignore[arg-type]
    await asyncio.to_thread(begun.wait, WAIT_S)
    end(asker, answer)
    await asyncio.wait_for(answer, WAIT_S)


def test_the_work_ends_when_the_asker_leaves() -> None:
    with pytest.raises(AskerLeftError):
        asyncio.run(_ended_by(lambda asker, _: asker.left.set()))


def test_the_work_ends_when_the_server_stops() -> None:
    with pytest.raises(ShuttingDownError):
        asyncio.run(_ended_by(lambda asker, _: asker.state.stopping.set()))


def test_a_stopping_server_begins_nothing() -> None:
    async def scenario() -> None:
        asker = Asker()
        asker.state.stopping.set()
        await answered(asker, lambda _: pytest.fail("it began"))  # type: ignore[arg-type]

    with pytest.raises(ShuttingDownError):
        asyncio.run(scenario())


def test_the_answer_comes_back() -> None:
    def compute(check: Check) -> int:
        check()
        return 7

    async def scenario() -> int:
        return await answered(Asker(), compute)  # type: ignore[arg-type]

    assert asyncio.run(scenario()) == 7

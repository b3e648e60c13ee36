"""Memory for bodies: bounded, in order, and nobody waits for ever."""

import asyncio
import random
from collections.abc import Coroutine
from typing import Any

import pytest

from tidemap.api.budget import SMALL_BYTES, SMALL_PART, Budget, Lane, LaneShare
from tidemap.errors import TooManyBodiesError

TOTAL = 100
LONG_S = 60.0


async def settle() -> None:
    """Let every task go as far as it can."""
    for _ in range(20):
        await asyncio.sleep(0)


def run(story: Coroutine[Any, Any, None]) -> None:
    asyncio.run(story)


def test_what_fits_is_given_at_once_and_given_back_at_the_end() -> None:
    async def story() -> None:
        lane = Lane(TOTAL, 0.0)
        for _ in range(3):
            with lane.share() as one, lane.share() as other:
                await one.grow(60)
                await other.grow(30)
                await other.grow(10)
                await other.grow(0)
                assert lane.held == TOTAL
        assert lane.held == 0

    run(story())


def test_one_may_overdraw_and_the_others_wait_their_turn() -> None:
    async def story() -> None:
        lane = Lane(TOTAL, LONG_S)
        order: list[str] = []
        ends = {name: asyncio.Event() for name in "abcd"}

        async def body(name: str, size: int) -> None:
            with lane.share() as share:
                await share.grow(size)
                order.append(name)
                await ends[name].wait()

        async with asyncio.TaskGroup() as tasks:
            for name, size in (("a", 80), ("b", 300), ("c", 30), ("d", 10)):
                tasks.create_task(body(name, size))
                await settle()
            assert (order, lane.held) == (["a", "b"], 380)
            ends["a"].set()
            await settle()
            assert order == ["a", "b"], "b alone holds more than all there is"
            ends["b"].set()
            await settle()
            assert (order, lane.held) == (["a", "b", "c", "d"], 40)
            ends["c"].set()
            ends["d"].set()
        assert lane.held == 0

    run(story())


def test_an_overdrawn_request_never_waits_again() -> None:
    async def story() -> None:
        lane = Lane(TOTAL, 0.0)
        with lane.share() as one, lane.share() as large:
            await one.grow(TOTAL)
            await large.grow(1)
            await large.grow(500)
            with pytest.raises(TooManyBodiesError):
                await one.grow(1)
            await one.grow(0)
            assert lane.held == 601

    run(story())


@pytest.mark.parametrize("seed", range(10))
def test_half_read_bodies_all_come_to_their_end(seed: int) -> None:
    """Each grows piece by piece, while the others hold what it wants."""

    async def body(share: LaneShare, rng: random.Random) -> None:
        for _ in range(10):
            await share.grow(rng.randrange(1, TOTAL // 10))
            await asyncio.sleep(0)

    async def story() -> None:
        lane, rng, most = Lane(TOTAL, LONG_S), random.Random(seed), 0

        async def read() -> None:
            nonlocal most
            with lane.share() as share:
                await body(share, rng)
                most = max(most, lane.held)

        async with asyncio.TaskGroup() as tasks:
            for _ in range(30):
                tasks.create_task(read())
        assert lane.held == 0
        assert most <= 2 * TOTAL

    run(story())


def test_retry_ends_and_the_next_in_line_goes_on() -> None:
    async def story() -> None:
        lane = Lane(TOTAL, 0.01)
        with lane.share() as one, lane.share() as two, lane.share() as three:
            await one.grow(90)
            await two.grow(20)
            with pytest.raises(TooManyBodiesError, match="nothing was stored"):
                await three.grow(50)
            assert lane.held == 110
        assert lane.held == 0
        with lane.share() as share:
            await share.grow(TOTAL)

    run(story())


def test_who_leaves_while_waiting_lets_the_next_one_pass() -> None:
    async def story() -> None:
        lane = Lane(TOTAL, LONG_S)
        with lane.share() as one, lane.share() as two, lane.share() as large, lane.share() as small:
            await one.grow(50)
            await two.grow(60)
            waiting = asyncio.create_task(large.grow(70))
            await settle()
            then = asyncio.create_task(small.grow(5))
            await settle()
            assert not then.done()
            waiting.cancel()
            await settle()
            assert not then.done(), "110 of 100 are held"
        await settle()
        assert then.done()

    run(story())


def test_small_bodies_go_on_beside_the_largest() -> None:
    async def story() -> None:
        budget = Budget(SMALL_PART * SMALL_BYTES)
        with budget.share() as largest, budget.share() as small, budget.share() as other:
            await largest.grow(100 * SMALL_BYTES)
            await small.grow(SMALL_BYTES)
            waiting = asyncio.create_task(other.grow(SMALL_BYTES + 1))
            await settle()
            assert not waiting.done(), "a large one waits for the largest"
            waiting.cancel()
            assert (largest.held, small.held, other.held) == (100 * SMALL_BYTES, SMALL_BYTES, 0)

    run(story())


def test_what_grows_large_waits_as_large_ones_do() -> None:
    async def story() -> None:
        budget = Budget(SMALL_PART * SMALL_BYTES)
        with budget.share() as first, budget.share() as second:
            await first.grow(100 * SMALL_BYTES)
            await second.grow(SMALL_BYTES // 2)
            waiting = asyncio.create_task(second.grow(SMALL_BYTES))
            await settle()
            assert not waiting.done()
            waiting.cancel()

    run(story())

"""Waiting for a job ends when the job, the asker or the server does."""

import asyncio
from collections.abc import Callable

from tests.support.askers import Asker
from tests.support.contexts import make_location
from tests.support.waiting import WAIT_S
from tidemap.api.waiting import wait_for_job
from tidemap.services.context import Context
from tidemap.services.jobs import request_update
from tidemap.services.update import UpdateRequest
from tidemap.storage.records import JobRecord

DAY_S = 86_400.0


def ended_by(ctx: Context, end: Callable[[Asker], object]) -> JobRecord:
    """Wait a day for a job that nobody does; what is answered when `end` was called."""

    async def scenario() -> JobRecord:
        asker, asked = Asker(ctx=ctx), asyncio.Event()
        loop = asyncio.get_running_loop()

        def find() -> JobRecord:
            loop.call_soon_threadsafe(asked.set)
            return request_update(ctx, "lab", UpdateRequest())

        waiting = asyncio.create_task(wait_for_job(asker, find, DAY_S))  # type: ignore[arg-type]
        await asked.wait()
        assert not (await asyncio.wait([waiting], timeout=0.05))[0]
        end(asker)
        return await asyncio.wait_for(waiting, WAIT_S)

    make_location(ctx)
    return asyncio.run(scenario())


def test_it_ends_when_the_asker_leaves(ctx: Context) -> None:
    assert ended_by(ctx, lambda asker: asker.left.set()).state == "queued"


def test_it_ends_when_the_server_stops(ctx: Context) -> None:
    assert ended_by(ctx, lambda asker: asker.state.stopping.set()).state == "queued"

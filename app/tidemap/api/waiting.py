"""Waiting for a job without holding a thread."""

import asyncio
from collections.abc import Callable

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request

from tidemap.api.askers import asker_left
from tidemap.api.state import state_of
from tidemap.events.subscription import EventFilter, listen
from tidemap.services.jobs import get_job
from tidemap.storage.records import JobRecord

JOBS = EventFilter(kinds=frozenset({"job"}))
POLL_S = 0.5
"""A message is a hint that may come from another process and get lost; so look now and then."""


async def wait_for_job(request: Request, find: Callable[[], JobRecord], wait_s: float) -> JobRecord:
    """What `find` returns, a new job or a known one, when it has ended or after `wait_s` seconds.

    Sooner where the asker leaves or the server stops; the job goes on.
    """
    state = state_of(request)
    ctx, loop = state.ctx, asyncio.get_running_loop()
    changed = asyncio.Event()

    unsubscribe = listen(ctx.bus, JOBS, lambda _: loop.call_soon_threadsafe(changed.set))
    try:
        job = await run_in_threadpool(find)
        deadline = loop.time() + wait_s
        async with asker_left(request) as left:
            while job.finished_at is None and not left.is_set() and not state.stopping.is_set():
                if (remaining_s := deadline - loop.time()) <= 0:
                    break
                changed.clear()
                job = await run_in_threadpool(get_job, ctx, job.id)
                if job.finished_at is None:
                    await _any(changed, min(POLL_S, remaining_s))
        return job
    finally:
        unsubscribe()


async def _any(changed: asyncio.Event, timeout_s: float) -> None:
    try:
        await asyncio.wait_for(changed.wait(), timeout_s)
    except TimeoutError:
        return

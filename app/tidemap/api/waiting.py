"""Waiting for a job without holding a thread."""

import asyncio
from collections.abc import Callable

from starlette.concurrency import run_in_threadpool

from tidemap.events.messages import EventMessage
from tidemap.schemas.jobs import Job
from tidemap.services.context import Context
from tidemap.services.jobs import get_job

POLL_S = 0.5
"""A message is a hint that may come from another process and get lost; so look now and then."""


async def wait_for_job(ctx: Context, request: Callable[[], Job], wait_s: float) -> Job:
    """Ask for a job, new or known, and follow it until it has ended or `wait_s` seconds have passed."""
    loop = asyncio.get_running_loop()
    changed = asyncio.Event()

    def listen(message: EventMessage) -> None:
        if message.kind == "job":
            loop.call_soon_threadsafe(changed.set)

    unsubscribe = ctx.bus.subscribe(listen)
    try:
        job = await run_in_threadpool(request)
        deadline = loop.time() + wait_s
        while job.finished_at is None and (left := deadline - loop.time()) > 0:
            changed.clear()
            job = await run_in_threadpool(get_job, ctx, job.id)
            if job.finished_at is None:
                await _any(changed, min(POLL_S, left))
        return job
    finally:
        unsubscribe()


async def _any(changed: asyncio.Event, timeout_s: float) -> None:
    try:
        await asyncio.wait_for(changed.wait(), timeout_s)
    except TimeoutError:
        return

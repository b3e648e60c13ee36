"""A worker of a Dask cluster: a process that runs the tasks of updates with a context of its own."""

import asyncio
import logging
from contextlib import suppress
from threading import Event

from distributed import Worker
from distributed.diagnostics.plugin import WorkerPlugin

from tidemap.services.context import Context
from tidemap.workers.dask_task import PLUGIN, RESOURCE

log = logging.getLogger(__name__)
REST_S = 1.0
"""From the loss of the scheduler until it is looked for again."""


class ContextPlugin(WorkerPlugin):
    """Lends the process's context to tasks."""

    name = PLUGIN

    def __init__(self, ctx: Context) -> None:
        self.ctx = ctx


def serve_cluster(ctx: Context, address: str, stop: Event) -> None:
    """Run tasks of the cluster at `address` until `stop` is set; looks for its scheduler as long as it takes."""
    asyncio.run(_until_stopped(ctx, address, stop))


async def _until_stopped(ctx: Context, address: str, stop: Event) -> None:
    stopping = asyncio.create_task(asyncio.to_thread(stop.wait))
    while not stop.is_set():
        membership = asyncio.create_task(_be_member(ctx, address))
        await asyncio.wait({membership, stopping}, return_when=asyncio.FIRST_COMPLETED)
        membership.cancel()
        with suppress(asyncio.CancelledError):
            try:
                await membership
            except Exception as error:
                # The package wraps whatever keeps a worker from joining. The process is to end by `stop` alone.
                cause = error.__cause__ or error
                log.warning("this process is no worker of the Dask cluster at %s: %r", address, cause)
        await asyncio.wait({stopping}, timeout=REST_S)


async def _be_member(ctx: Context, address: str) -> None:
    """Until the scheduler is lost."""
    threads = ctx.settings.update_threads
    async with Worker(
        address,
        nthreads=threads,
        resources={RESOURCE: threads},
        plugins=(ContextPlugin(ctx),),
        # Tasks keep nothing in the cluster's memory, so there is nothing to move to the disk.
        memory_limit=0,
        dashboard=False,
    ) as worker:
        log.info("this process runs tasks of the Dask cluster at %s", address)
        await worker.finished()
    log.warning("the Dask scheduler at %s is gone", address)

"""dask: what a task costs on its way through a Dask cluster of one worker, against what it may cost more than here."""

from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.bench.timing import Figure, interleaved
from tests.support.cluster import running_cluster
from tests.support.contexts import opened
from tests.support.databases import SqliteDatabases
from tests.support.tasks import negate
from tidemap.workers.dask_executor import DaskExecutor
from tidemap.workers.executors import LocalExecutor

N_TASKS = 200
ALLOWED_MS = 15.0
"""More than on a thread; a task of an update takes some 100 ms where all of its cells change."""


def measure(n_tasks: int = N_TASKS, rounds: int = 5) -> Figure:
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory()))
        url = stack.enter_context(SqliteDatabases(folder).migrated())
        ctx = stack.enter_context(opened(url))
        cluster = stack.enter_context(running_cluster(folder))
        cluster.worker(url)
        remote, local = DaskExecutor(cluster.address), LocalExecutor(ctx, ctx.settings.update_threads)
        stack.callback(remote.close)
        stack.callback(local.close)
        here, there = interleaved(
            lambda: list(local.map(negate, range(n_tasks))),
            lambda: list(remote.map(negate, range(n_tasks))),
            rounds=rounds,
        )
    more_ms = (there - here) / n_tasks * 1e3
    return Figure(more_ms, ALLOWED_MS, 1.0, "ms/task", {"tasks": n_tasks, "threads": ctx.settings.update_threads})

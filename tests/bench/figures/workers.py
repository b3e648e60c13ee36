"""workers: an update of 10^6 cells, a tenth changing, 2,016 samples, on threads and on the workers of a Dask cluster.

The value is what three workers take of the machine, in processor seconds of all processes, the floor what one thread of
this process takes: other work beside it lengthens the times and not these. `details` has the seconds of one and two
threads and of one to three workers, and with `cores` processors how much of their share of the work that is.
`WORKERS_CELLS=100000 python -m tests.bench workers` takes a smaller hall.
"""

import os
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from tests.bench import million
from tests.bench.databases import postgres
from tests.bench.load import cpu_clock
from tests.bench.timing import Figure
from tests.support.cluster import Cluster, running_cluster
from tests.support.contexts import opened
from tests.support.forked import Forked
from tidemap.services.context import Context
from tidemap.services.locations import find_location
from tidemap.services.update import UpdateRequest, run_update
from tidemap.services.update_task import Executor
from tidemap.workers.dask_executor import DaskExecutor
from tidemap.workers.executors import LocalExecutor

BY_NAME = True
MAX_WORKERS = 3


def measure(cells: int = int(os.environ.get("WORKERS_CELLS", "1000000"))) -> Figure:
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="tidemap-bench-")))
        url = stack.enter_context(postgres())
        ctx = stack.enter_context(opened(url))
        million.make(ctx, (cells // 1000, 100, 10))
        details: dict[str, float | int | str] = {"cells": cells, "tasks": find_location(ctx, million.NAME).n_chunks}
        details["cores"] = os.cpu_count() or 1
        floor_s = _on_threads(ctx, details)
        value_s = _on_workers(ctx, stack.enter_context(running_cluster(folder)), url, details)
    details["efficiency"] = round(float(details["thread_1_s"]) / float(details["worker_2_s"]) / 2, 2)
    return Figure(value_s, floor_s, 1.25, "s CPU", details)


def _on_threads(ctx: Context, details: dict[str, float | int | str]) -> float:
    """With one, and then two; the processor seconds of one."""
    taken = []
    for threads in (1, 2):
        executor = LocalExecutor(ctx, threads)
        seconds, cpu_s = _updated(ctx, executor, time.process_time)
        executor.close()
        details[f"thread_{threads}_s"] = round(seconds, 1)
        taken.append(cpu_s)
    return taken[0]


def _on_workers(ctx: Context, cluster: Cluster, url: str, details: dict[str, float | int | str]) -> float:
    """With one, two and three of a thread each; the processor seconds with three, without those of the database."""
    executor = DaskExecutor(cluster.address)
    workers: list[Forked] = []
    for number in range(1, 1 + MAX_WORKERS):
        workers.append(cluster.worker(url, {"TIDEMAP_UPDATE_THREADS": "1"}))
        seconds, cpu_s = _updated(ctx, executor, lambda: _cpu_s([*(each.pid for each in workers), cluster.pid]))
        details[f"worker_{number}_s"] = round(seconds, 1)
    executor.close()
    return cpu_s


def _cpu_s(pids: list[int]) -> float:
    """Of this process and others so far."""
    return time.process_time() + sum(time.clock_gettime(cpu_clock(pid)) for pid in pids)


def _updated(ctx: Context, executor: Executor, cpu_s: Callable[[], float]) -> tuple[float, float]:
    """Seconds, and processor seconds."""
    location, request = find_location(ctx, million.NAME).id, UpdateRequest(estimator="calendar")
    started, before = time.perf_counter(), cpu_s()
    run_update(ctx, location, request, executor, lambda _: None)
    return time.perf_counter() - started, cpu_s() - before

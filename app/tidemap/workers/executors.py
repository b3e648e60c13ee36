"""Executors: where the tasks of an update run."""

from collections.abc import Callable, Iterable
from concurrent.futures import CancelledError, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Protocol, TypeVar

from tidemap.errors import ShuttingDownError
from tidemap.services.context import Context
from tidemap.services.update_task import Executor
from tidemap.workers.priority import give_way

Item = TypeVar("Item")
Value = TypeVar("Value")


@dataclass(frozen=True, slots=True)
class Limited:
    """Another executor, as long as `limit` raises nothing."""

    executor: Executor
    limit: Callable[[], None]

    def map(self, run: Callable[[Context, Item], Value], items: Iterable[Item]) -> Iterable[Value]:
        """As the other one."""
        return self.executor.map(run, items)

    def check(self) -> None:
        """Raises what either of the two raises."""
        self.executor.check()
        self.limit()


class Pool(Executor, Protocol):
    """An executor of this process's own, which ends it."""

    def on_wait(self, listener: Callable[[str | None], None]) -> None:
        """Call `listener` with what tasks wait for, and with None where they run."""
        ...

    def request_stop(self) -> None:
        """Let running tasks end and start no more."""
        ...

    def close(self) -> None:
        """The same, and wait until they have ended."""
        ...


def open_executor(ctx: Context) -> Pool:
    """Where the settings have updates run: on threads of this process, or on a Dask cluster."""
    address = ctx.settings.dask_scheduler
    if address is None:
        return LocalExecutor(ctx, ctx.settings.update_threads)
    from tidemap.workers.dask_executor import DaskExecutor

    return DaskExecutor(address)


class LocalExecutor:
    """Threads of this process, which give way to those that answer; the kernels release the GIL."""

    def __init__(self, ctx: Context, threads: int) -> None:
        self._ctx = ctx
        self._pool = ThreadPoolExecutor(threads, "tidemap-update", give_way)
        self._closed = False

    def on_wait(self, listener: Callable[[str | None], None]) -> None:
        """Threads are always there: nothing is ever waited for."""

    def map(self, run: Callable[[Context, Item], Value], items: Iterable[Item]) -> Iterable[Value]:
        """Results in the order of the items. Raises ShuttingDownError when it is closed before the last."""
        try:
            yield from self._pool.map(partial(run, self._ctx), items)
        except (CancelledError, RuntimeError):
            if self._closed:
                raise ShuttingDownError from None
            raise

    def check(self) -> None:
        """Raises ShuttingDownError once nothing more is to be started."""
        if self._closed:
            raise ShuttingDownError

    def request_stop(self) -> None:
        """Let running tasks end and start no more."""
        self._closed = True
        self._pool.shutdown(wait=False, cancel_futures=True)

    def close(self) -> None:
        """The same, and wait until they have ended."""
        self.request_stop()
        self._pool.shutdown()

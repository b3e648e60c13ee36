"""Executors: where the tasks of an update run."""

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Value = TypeVar("Value")


class LocalExecutor:
    """Threads of this process; the kernels release the GIL."""

    def __init__(self, threads: int) -> None:
        self._pool = ThreadPoolExecutor(threads, thread_name_prefix="tidemap-update")

    def map(self, task: Callable[[Item], Value], items: Iterable[Item]) -> Iterable[Value]:
        """Results in the order of the items."""
        return self._pool.map(task, items)

    def close(self) -> None:
        """Let running tasks end and start no more."""
        self._pool.shutdown(wait=True, cancel_futures=True)

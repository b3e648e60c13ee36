"""DaskExecutor: the tasks of an update on the workers of a Dask cluster."""

import logging
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from itertools import islice
from threading import Event, Lock
from typing import TypeVar

from distributed import Client, Future
from distributed.client import FutureCancelledError
from distributed.comm.core import CommClosedError

from tidemap.errors import ClusterUnavailableError, ShuttingDownError
from tidemap.services.context import Context
from tidemap.workers.dask_task import RESOURCE, pack, run_packed

log = logging.getLogger(__name__)
Item = TypeVar("Item")
Value = TypeVar("Value")
CONNECT_S = 5.0
CHECK_S = 0.25
"""How often to ask, while a task runs, whether it is still to be waited for."""
AHEAD = 64
"""Tasks that are with the cluster at once, at least; it gets twice as many as its workers have threads."""
ALIVE = ("running", "connecting")
"""States of a client that has a scheduler, or looks for the one it lost for a moment."""
LOST = (CommClosedError, FutureCancelledError, OSError)
"""What a scheduler that is gone looks like."""


class DaskExecutor:
    """Workers that `tidemap worker` started; each loads and stores what its tasks need by itself.

    The scheduler is asked for with the first task, and again after it was lost. It runs the tasks of a worker that
    died on another one.
    """

    def __init__(self, address: str) -> None:
        self._address = address
        self._lock = Lock()
        self._client: Client | None = None
        self._closed = False

    def map(self, run: Callable[[Context, Item], Value], items: Iterable[Item]) -> Iterator[Value]:
        """Results in the order of the items.

        Raises what a task raised, ShuttingDownError when it is closed before the last, ClusterUnavailableError when
        the scheduler does not answer. Then tasks that have not begun are taken back.
        """
        self.check()
        begun: deque[Future[Value]] = deque()
        left = iter(items)
        try:
            with self._reaching() as client:
                begun.extend(_submit(client, run, item) for item in islice(left, _ahead(client)))
            while begun:
                yield self._result(begun.popleft())
                with self._reaching() as client:
                    begun.extend(_submit(client, run, item) for item in islice(left, 1))
        finally:
            for future in begun:
                future.release()

    def check(self) -> None:
        """Raises ShuttingDownError once nothing more is to be started."""
        if self._closed:
            raise ShuttingDownError

    def request_stop(self) -> None:
        """Wait for no task any more, and start none."""
        self._closed = True

    def close(self) -> None:
        """The same, and leave the cluster."""
        self.request_stop()
        self._disconnect()

    def _result(self, future: "Future[Value]") -> Value:
        """What a task returned. Raises what it raised, and what `check` raises while it runs."""
        with self._reaching():
            self._wait(future)
            error = future.exception() if future.status == "error" else None
            if error is None:
                return future.result()
        raise error

    def _wait(self, future: "Future[Value]") -> None:
        done = Event()
        future.add_done_callback(lambda _: done.set())
        while not done.wait(CHECK_S):
            self.check()
            if future.client.status not in ALIVE:
                raise CommClosedError

    @contextmanager
    def _reaching(self) -> Iterator[Client]:
        """The cluster's client. Raises ClusterUnavailableError where the scheduler does not answer meanwhile."""
        try:
            yield self._connected()
        except LOST as error:
            self._disconnect()
            raise ClusterUnavailableError(self._address) from error

    def _connected(self) -> Client:
        with self._lock:
            if self._client is None or self._client.status != "running":
                self._client = Client(self._address, timeout=CONNECT_S, set_as_default=False, name="tidemap")
                log.info("updates run on the Dask cluster at %s", self._address)
            return self._client

    def _disconnect(self) -> None:
        with self._lock:
            client, self._client = self._client, None
        if client is not None:
            client.close(timeout=CONNECT_S)


def _ahead(client: Client) -> int:
    threads: int = sum(client.nthreads().values())
    return max(AHEAD, 2 * threads)


def _submit(client: Client, run: Callable[[Context, Item], Value], item: Item) -> "Future[Value]":
    # Not pure: the same task of a later update is another one, whatever its name would say.
    return client.submit(run_packed, pack(run, item), pure=False, resources={RESOURCE: 1})

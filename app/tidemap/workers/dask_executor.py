"""DaskExecutor: the tasks of an update on the workers of a Dask cluster."""

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from itertools import islice
from threading import Event, Lock
from time import monotonic
from typing import TypeVar

from distributed import Client, Future, KilledWorker, Security
from distributed.client import FutureCancelledError
from distributed.comm.core import CommClosedError, connect

from tidemap.errors import ClusterUnavailableError, ShuttingDownError, WorkersDiedError
from tidemap.services.context import Context
from tidemap.version import __version__
from tidemap.workers.dask_task import RESOURCE, pack, run_packed

log = logging.getLogger(__name__)
Item = TypeVar("Item")
Value = TypeVar("Value")
CONNECT_S = 5.0
CHECK_S = 0.25
"""How often to ask, while a task runs, whether it is still to be waited for."""
ASK_S = 5.0
"""How often to ask the scheduler then whether it still answers, and has workers."""
AHEAD = 64
"""Tasks that are with the cluster at once, at least; it gets twice as many as its workers have threads."""
ALIVE = ("running", "connecting")
"""States of a client that has a scheduler, or looks for the one it lost for a moment."""
LOST = (CommClosedError, FutureCancelledError, OSError)
"""What a scheduler that is gone looks like."""
_NO_WORKER = (
    "No `tidemap worker` of version {version} is at the Dask cluster at {address}. Updates wait for one; start it."
)


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
        self._reason: str | None = None
        self._listeners: tuple[Callable[[str | None], None], ...] = ()

    def on_wait(self, listener: Callable[[str | None], None]) -> None:
        """Call `listener` with what tasks wait for, now and then as long as they do, and with None where they run."""
        self._listeners += (listener,)

    def map(self, run: Callable[[Context, Item], Value], items: Iterable[Item]) -> Iterator[Value]:
        """Results in the order of the items.

        Raises what a task raised, ShuttingDownError when it is closed before the last, ClusterUnavailableError when
        the scheduler does not answer, WorkersDiedError when a task kills what runs it. Then tasks that have not begun
        are taken back.
        """
        self.check()
        begun: deque[tuple[Item, Future[Value]]] = deque()
        left = iter(items)
        try:
            with self._reaching() as client:
                begun.extend((item, _submit(client, run, item)) for item in islice(left, self._ahead(client)))
            while begun:
                yield self._result(*begun.popleft())
                with self._reaching() as client:
                    begun.extend((item, _submit(client, run, item)) for item in islice(left, 1))
        finally:
            for _, future in begun:
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

    def _result(self, item: Item, future: "Future[Value]") -> Value:
        """What a task returned. Raises what it raised, and what `check` raises while it runs."""
        with self._reaching():
            self._wait(future)
            error = future.exception() if future.status == "error" else None
            if error is None:
                return future.result()
        if isinstance(error, KilledWorker):
            raise WorkersDiedError(str(item), error.last_worker.address) from error
        raise error

    def _wait(self, future: "Future[Value]") -> None:
        done, asked = Event(), monotonic()
        future.add_done_callback(lambda _: done.set())
        while not done.wait(CHECK_S):
            self.check()
            if future.client.status not in ALIVE:
                raise CommClosedError
            if monotonic() - asked >= ASK_S:
                self._threads(future.client)
                asked = monotonic()

    def _ahead(self, client: Client) -> int:
        return max(AHEAD, 2 * self._threads(client))

    def _threads(self, client: Client) -> int:
        """Those of the cluster that run our tasks. Raises TimeoutError where the scheduler does not answer."""
        if client.scheduler is None:
            raise CommClosedError
        known = client.sync(client.scheduler.identity, callback_timeout=CONNECT_S)
        threads: int = sum(each["nthreads"] for each in known["workers"].values() if RESOURCE in each["resources"])
        self._report(None if threads else _NO_WORKER.format(version=__version__, address=self._address))
        return threads

    def _report(self, reason: str | None) -> None:
        """Say what tasks wait for, in the log once."""
        if reason and reason != self._reason:
            log.warning("%s", reason)
        self._reason = reason
        for listener in self._listeners:
            listener(reason)

    @contextmanager
    def _reaching(self) -> Iterator[Client]:
        """The cluster's client. Raises ClusterUnavailableError where the scheduler does not answer meanwhile."""
        try:
            yield self._connected()
        except LOST as error:
            self._disconnect()
            self.check()
            unavailable = ClusterUnavailableError(self._address)
            self._report(str(unavailable))
            raise unavailable from error

    def _connected(self) -> Client:
        with self._lock:
            if self._client is None or self._client.status != "running":
                self.check()
                _close(self._client)
                self._client = None
                self._client = _connect(self._address)
                log.info("updates run on the Dask cluster at %s", self._address)
            return self._client

    def _disconnect(self) -> None:
        with self._lock:
            client, self._client = self._client, None
        _close(client)


def _connect(address: str) -> Client:
    """Raises OSError where no scheduler answers."""
    security = Security()
    # A client waits for ever for the first word of one that takes the connection and is silent.
    asyncio.run(_greet(address, security))
    return Client(address, timeout=CONNECT_S, security=security, set_as_default=False, name="tidemap")


async def _greet(address: str, security: Security) -> None:
    how = security.get_connection_args("client")
    comm = await asyncio.wait_for(connect(address, timeout=CONNECT_S, **how), CONNECT_S)
    comm.abort()


def _close(client: Client | None) -> None:
    if client is not None:
        with suppress(OSError):
            client.close(timeout=CONNECT_S)


def _submit(client: Client, run: Callable[[Context, Item], Value], item: Item) -> "Future[Value]":
    # Not pure: the same task of a later update is another one, whatever its name would say.
    return client.submit(run_packed, pack(run, item), pure=False, resources={RESOURCE: 1})

"""The one writer: a thread that takes writes from a bounded queue and commits them in groups."""

import logging
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from itertools import groupby
from queue import Empty, Full, Queue
from threading import Lock, Thread
from typing import Any, Generic, TypeAlias, TypeVar

from sqlalchemy import Connection, Engine
from sqlalchemy.exc import DBAPIError

from tidemap.errors import DomainError, QueueFullError, ShuttingDownError, StorageUnavailableError
from tidemap.storage.changes import Changes
from tidemap.storage.checkpoint import Checkpoints
from tidemap.storage.counters import take
from tidemap.storage.gate import Gate
from tidemap.storage.outage import OutageTracker, is_outage
from tidemap.storage.work import Work

log = logging.getLogger(__name__)
Item = TypeVar("Item")
Result = TypeVar("Result")
RunAll: TypeAlias = Callable[[Work, Sequence[Item]], Sequence[Result | DomainError]]
"""Writes many items at once; of each its result, or why nothing of it was written."""


@dataclass(slots=True, eq=False)
class _Write(Generic[Item, Result]):
    run_all: RunAll[Item, Result]
    make: Callable[[], Item]
    then: Callable[[Result], None] | None
    future: Future[Result] = field(default_factory=Future)
    item: Item = field(init=False)

    def begin(self) -> bool:
        """Make the item; False where that fails or nobody waits for it any more, and there is nothing to be written."""
        if not self.future.set_running_or_notify_cancel():
            return False
        try:
            self.item = self.make()
        except BaseException as error:
            self.future.set_exception(error)
            return False
        return True


class Writer:
    """Runs writes one after the other, a group of them in one durable commit; one that fails takes no other along.

    A write may be run again, and so does nothing but what its transaction undoes."""

    def __init__(self, engine: Engine, queue_length: int, batch: int, gate: Gate) -> None:
        self._engine = engine
        self._batch = batch
        self._queue: Queue[_Write[Any, Any] | None] = Queue(queue_length)
        self.outage = OutageTracker("written")
        self.changes = Changes(engine)
        self._gate = Lock()
        self._closed = False
        self._checkpoints = Checkpoints(engine, gate)
        self.rest_s = 0.0
        """How long it rests after every group: larger groups are what comes of it, and senders that wait."""
        self.on_commit: Callable[[float], object] = lambda _: None
        """Called with the seconds that each group took."""
        self._thread = Thread(target=self._loop, name="tidemap-writer", daemon=True)
        self._thread.start()

    def submit(self, run: Callable[[Work], Result], then: Callable[[Result], None] | None = None) -> Future[Result]:
        """The future of a write: its result once it is durable, or the error it raised (nothing was stored then).

        StorageUnavailableError alone leaves that open: a connection may be lost after the commit, before its answer.

        `then` is called with the result before anybody else gets it, in the writer's thread and so in the order of
        the commits; it should be quick.
        Raises QueueFullError, ShuttingDownError.
        """
        return self.submit_item(_each, run, then)

    def submit_item(
        self, run_all: RunAll[Item, Result], item: Item, then: Callable[[Result], None] | None = None
    ) -> Future[Result]:
        """As `submit`, of an item that is written together with those beside it that have the same `run_all`."""
        return self.submit_deferred(run_all, lambda: item, then)

    def submit_deferred(
        self, run_all: RunAll[Item, Result], make: Callable[[], Item], then: Callable[[Result], None] | None = None
    ) -> Future[Result]:
        """As `submit_item`, of an item that `make` makes in the writer's thread, just before its group is stored.

        All writes wait for it, so it should be quick; the future has what it raises. A thread that makes the items of
        a group and stores them has nobody to share the interpreter with.
        """
        write = _Write(run_all, make, then)
        with self._gate:
            if self._closed:
                raise ShuttingDownError
            try:
                self._queue.put_nowait(write)
            except Full:
                raise QueueFullError from None
        return write.future

    def waiting(self) -> int:
        """How many writes wait."""
        return self._queue.qsize()

    def close(self) -> None:
        """Take no more writes, finish those that were taken."""
        with self._gate:
            already, self._closed = self._closed, True
        if not already:
            self._queue.put(None)
        self._thread.join()
        self.changes.close()

    def _loop(self) -> None:
        open_ = True
        while open_:
            group, open_ = self._next_group()
            if group:
                began = time.perf_counter()
                self._commit(group)
                self.on_commit(time.perf_counter() - began)
                self._care()

    def _care(self) -> None:
        """What is done between commits and harms none of them when it fails."""
        if self.rest_s:
            time.sleep(self.rest_s)
        try:
            self._checkpoints.care()
        except Exception:
            log.exception("the log file of the database was not shortened")

    def _next_group(self) -> tuple[list[_Write[Any, Any]], bool]:
        """The writes that wait, and those that come while their items are made; and whether there may be more."""
        item = self._queue.get()
        group: list[_Write[Any, Any]] = []
        while item is not None:
            if item.begin():
                group.append(item)
            if len(group) == self._batch:
                return group, True
            try:
                item = self._queue.get_nowait()
            except Empty:
                return group, True
        return group, False

    def _commit(self, group: list[_Write[Any, Any]]) -> None:
        """Settle every future, whatever happens: nobody waits for ever, and this thread goes on."""
        if self.outage.reason is not None or not self._commit_together(group):
            self._commit_apart(group)

    def _commit_together(self, group: list[_Write[Any, Any]]) -> bool:
        """Store a group as one; False, and nothing stored, where one of its writes fails, as hardly ever one does."""
        results: list[Any] = []
        try:
            with self._transaction() as connection:
                work = Work.on(connection)
                for part in _parts(group):
                    results.extend(part[0].run_all(work, [write.item for write in part]))
        except BaseException as error:
            lost = isinstance(error, DBAPIError) and error.connection_invalidated
            if len(results) < len(group) and not lost:
                return False
            # After a commit that failed nobody knows whether it is stored: it must not be run again.
            self._refuse(group, error)
        else:
            for write, result in zip(group, results, strict=True):
                _finish(write, result)
        return True

    def _commit_apart(self, group: list[_Write[Any, Any]], again: bool = True) -> None:
        """Store what can be stored of a group, each write behind a savepoint, which costs as much as a small write."""
        problems: list[DBAPIError] = []
        try:
            with self._transaction() as connection:
                settle = [self._run(connection, write, again, problems) for write in group]
                if self.outage.reason is not None:
                    # Some writes change nothing; that they succeed does not say that it can be written.
                    take(connection, "trouble")
            if not problems:
                self.outage.worked()
        except BaseException as error:
            self._refuse(group, error)
            return
        for each in settle:
            each()

    @contextmanager
    def _transaction(self) -> Iterator[Connection]:
        """A transaction; whatever becomes of it, what it changes is known before anybody hears of that."""
        with self._engine.connect() as connection:
            driver = connection.connection.dbapi_connection
            try:
                with connection.begin():
                    yield connection
                    self.changes.committing()
            finally:
                self.changes.committed(driver)

    def _run(
        self, connection: Connection, write: _Write[Any, Any], again: bool, problems: list[DBAPIError]
    ) -> Callable[[], None]:
        """Run a write in a savepoint; returns what settles its future once the group is durable, and notes a problem.

        Raises where the transaction has ended under it, as it does when the connection is lost and, in SQLite, when
        the disk is full: then none of the group is stored.
        """
        savepoint = connection.begin_nested()
        try:
            (result,) = write.run_all(Work.on(connection), [write.item])
            savepoint.commit()
        except DBAPIError as error:
            if error.connection_invalidated:
                raise
            try:
                savepoint.rollback()
            except DBAPIError:
                raise error from None
            problems.append(error)
            if again:
                # Another process may have been in its way: once more, without the locks of a group.
                return partial(self._commit_apart, [write], again=False)
            self._failed("a write was refused by the database", error)
            return partial(write.future.set_exception, StorageUnavailableError())
        except BaseException as error:
            savepoint.rollback()
            return partial(write.future.set_exception, error)
        return partial(_finish, write, result)

    def _refuse(self, group: list[_Write[Any, Any]], error: BaseException) -> None:
        self._failed(f"a group of {len(group)} writes was not stored", error)
        for write in group:
            write.future.set_exception(StorageUnavailableError())

    def _failed(self, what: str, error: BaseException) -> None:
        """A change of state where the database is in trouble, one line for what else it says, a trace for the rest."""
        if not isinstance(error, DBAPIError):
            log.error(what, exc_info=error)
        elif is_outage(error):
            self.outage.failed(error)
        else:
            log.error("%s: %s", what, " ".join(str(error.orig).split()))


def _each(work: Work, runs: Sequence[Callable[[Work], Result]]) -> list[Result]:
    """Writes that have nothing in common."""
    return [run(work) for run in runs]


def _parts(group: list[_Write[Any, Any]]) -> Iterator[list[_Write[Any, Any]]]:
    """Neighbours that are written together."""
    for _, part in groupby(group, key=lambda write: write.run_all):
        yield list(part)


def _finish(write: _Write[Item, Result], result: Result | DomainError) -> None:
    if isinstance(result, DomainError):
        write.future.set_exception(result)
        return
    try:
        if write.then is not None:
            write.then(result)
    except BaseException:
        log.exception("what follows a write failed; it is stored all the same")
    write.future.set_result(result)

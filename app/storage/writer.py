"""The one writer: a thread that takes writes from a bounded queue and commits them in groups."""

import logging
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from queue import Empty, Full, Queue
from threading import Lock, Thread
from typing import Any, Generic, TypeVar

from sqlalchemy import Connection, Engine
from sqlalchemy.exc import DBAPIError, SQLAlchemyError

from app.errors import QueueFullError, ShuttingDownError, StorageUnavailableError
from app.storage.work import Work

log = logging.getLogger(__name__)
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class _Write(Generic[Result]):
    run: Callable[[Work], Result]
    future: Future[Result]


class Writer:
    """Runs writes one after the other; each gets its own savepoint, a group of them one durable commit."""

    def __init__(self, engine: Engine, queue_length: int, batch: int) -> None:
        self._engine = engine
        self._batch = batch
        self._queue: Queue[_Write[Any] | None] = Queue(queue_length)
        self._gate = Lock()
        self._closed = False
        self._thread = Thread(target=self._loop, name="tidemap-writer", daemon=True)
        self._thread.start()

    def submit(self, run: Callable[[Work], Result]) -> Future[Result]:
        """The future of a write: its result once it is durable, or the error it raised (nothing was stored then).

        Raises QueueFullError, ShuttingDownError.
        """
        future: Future[Result] = Future()
        with self._gate:
            if self._closed:
                raise ShuttingDownError
            try:
                self._queue.put_nowait(_Write(run, future))
            except Full:
                raise QueueFullError from None
        return future

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

    def _loop(self) -> None:
        open_ = True
        while open_:
            group, open_ = self._next_group()
            if group:
                self._commit(group)

    def _next_group(self) -> tuple[list[_Write[Any]], bool]:
        """The writes that wait, at least one, and whether there may be more."""
        item = self._queue.get()
        group: list[_Write[Any]] = []
        while item is not None:
            group.append(item)
            if len(group) == self._batch:
                return group, True
            try:
                item = self._queue.get_nowait()
            except Empty:
                return group, True
        return group, False

    def _commit(self, group: list[_Write[Any]]) -> None:
        done: list[tuple[Future[Any], Any]] = []
        failed: list[tuple[Future[Any], BaseException]] = []
        try:
            with self._engine.begin() as connection:
                for write in group:
                    self._run(connection, write, done, failed)
        except SQLAlchemyError as error:
            log.error("a group of %d writes was not stored: %s", len(group), error)
            unavailable = StorageUnavailableError()
            failed = [(write.future, unavailable) for write in group]
            done = []
        for future, result in done:
            future.set_result(result)
        for future, reason in failed:
            future.set_exception(reason)

    def _run(
        self,
        connection: Connection,
        write: _Write[Any],
        done: list[tuple[Future[Any], Any]],
        failed: list[tuple[Future[Any], BaseException]],
    ) -> None:
        try:
            with connection.begin_nested():
                result = write.run(Work.on(connection))
        except DBAPIError as error:
            if error.connection_invalidated or not connection.in_transaction():
                raise
            log.exception("a write was refused by the database")
            failed.append((write.future, StorageUnavailableError()))
        except Exception as error:
            failed.append((write.future, error))
        else:
            done.append((write.future, result))

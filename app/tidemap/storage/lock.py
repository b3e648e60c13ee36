"""The lock that one process on a database holds at a time; its holder has the current term."""

import fcntl
import os
from pathlib import Path
from typing import Protocol

from sqlalchemy import Connection, make_url, text
from sqlalchemy.exc import DBAPIError

from tidemap.storage.engine import open_watch, open_writer
from tidemap.storage.fencing import FencingTokens
from tidemap.storage.outage import is_outage

# A number of its own, and that of a table, so that two schemas of one database do not share it.
_TRY = text("SELECT pg_try_advisory_lock(7364125, CAST(CAST('counter' AS regclass) AS oid)::int)")
_HELD = text("SELECT EXISTS (SELECT FROM pg_locks WHERE classid = 7364125 AND pid = pg_backend_pid() AND granted)")


class Lock(Protocol):
    """Let go by the system, or by the database, when its process dies."""

    shared: bool
    """Whether several processes are meant to want it."""

    def take(self) -> int | None:
        """The number of the term that begins where nobody has the lock; None where somebody has, or nobody can."""

    def held(self) -> bool:
        """Whether it still is; to be asked all the time."""

    def release(self) -> None:
        """Let go of it, if it is held."""


def open_lock(url: str) -> Lock:
    """The lock of the database at `url`."""
    address = make_url(url)
    if address.get_backend_name() == "sqlite":
        return FileLock(url, Path(f"{address.database}-background"))
    return AdvisoryLock(url)


class FileLock:
    """A file beside a SQLite file, locked by flock: SQLite's own locks end with any connection of the process."""

    shared = False

    def __init__(self, url: str, path: Path) -> None:
        self._url = url
        self._path = path
        self._descriptor: int | None = None

    def take(self) -> int | None:
        """As `Lock`. Raises OSError where the file cannot be made."""
        descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(descriptor)
            return None
        self._descriptor = descriptor
        try:
            # Its last holder may have removed the file since it was opened here.
            if self.held():
                return self._begin()
        except DBAPIError as error:
            self.release()
            _refuse_others(error)
        self.release()
        return None

    def held(self) -> bool:
        """As `Lock`: not where the file was removed, for others lock another one then."""
        try:
            return self._descriptor is not None and os.path.samestat(os.fstat(self._descriptor), self._path.stat())
        except FileNotFoundError:
            return False

    def release(self) -> None:
        """As `Lock`, with its file."""
        if self._descriptor is not None:
            if self.held():
                self._path.unlink()
            os.close(self._descriptor)
            self._descriptor = None

    def _begin(self) -> int:
        engine = open_writer(self._url)
        try:
            with engine.begin() as connection:
                return FencingTokens(connection).begin()
        finally:
            engine.dispose()


class AdvisoryLock:
    """A session's advisory lock in PostgreSQL, on a connection of its own, which is never to be idle for long."""

    shared = True

    def __init__(self, url: str) -> None:
        self._engine = open_watch(url)
        self._connection: Connection | None = None

    def take(self) -> int | None:
        """As `Lock`. The connection stays open for the next try."""
        try:
            if self._connection is None:
                self._connection = self._engine.connect()
            if self._connection.execute(_TRY).scalar():
                return FencingTokens(self._connection).begin()
        except DBAPIError as error:
            self.release()
            _refuse_others(error)
        return None

    def held(self) -> bool:
        """As `Lock`: as long as its connection lives."""
        try:
            return self._connection is not None and bool(self._connection.execute(_HELD).scalar())
        except DBAPIError:
            return False

    def release(self) -> None:
        """As `Lock`: with the connection."""
        if self._connection is not None:
            self._connection.invalidate()
            self._connection.close()
            self._connection = None


def _refuse_others(error: DBAPIError) -> None:
    """Raise errors other than a database that is away or busy; those are reported to the clients that post."""
    if not is_outage(error):
        raise error

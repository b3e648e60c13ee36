"""Outages: whether the database can be used, as the last try showed. Changes are logged, not every try."""

import logging
import sqlite3
from threading import Lock

from sqlalchemy.exc import DBAPIError, OperationalError

log = logging.getLogger(__name__)


def is_outage(error: BaseException) -> bool:
    """Whether the database is away or cannot work, rather than having been asked something wrong."""
    return isinstance(error, OperationalError) or (isinstance(error, DBAPIError) and error.connection_invalidated)


class OutageTracker:
    """What is wrong with one way of using the database, such as `written`."""

    def __init__(self, used: str) -> None:
        self._used = used
        self._lock = Lock()
        self._reason: str | None = None
        self._times = 0

    @property
    def reason(self) -> str | None:
        """In words for everybody: nothing of the database's address; None when all is well."""
        return self._reason

    def failed(self, error: DBAPIError) -> None:
        """The database failed."""
        with self._lock:
            first, self._reason = self._reason is None, _words(error)
            self._times += 1
        if first:
            said = " ".join(str(error.orig).split())
            log.error("the database cannot be %s: %s. Requests are refused with 503 until it can", self._used, said)

    def worked(self) -> None:
        """The database did what it was asked to."""
        if self._reason is None:
            return
        with self._lock:
            times, self._times, self._reason = self._times, 0, None
        log.warning("the database can be %s again, after %d failures", self._used, times)


def _words(error: DBAPIError) -> str:
    """SQLite says what it is; what a server says may name hosts and users."""
    return str(error.orig) if isinstance(error.orig, sqlite3.Error) else type(error.orig).__name__

"""Changes: a number that stays as long as nothing is stored that lists of events or the right to see them depend on."""

import sqlite3
from threading import Lock
from typing import Any

from sqlalchemy import Connection, Engine, Update, event
from sqlalchemy.sql.dml import UpdateBase

from tidemap.storage.tables import anomaly, api_key, location, session

COUNTED = frozenset({anomaly, location, api_key, session})
"""The tables that lists of events and the right to see them are read from."""
UNCOUNTED = {"uncounted": True}
"""Options of a statement that changes only what no list of events shows, though it is in one of these tables."""


class Changes:
    """Of the database of one writer: around its commits it calls `committing` and `committed`, in its thread.

    Of a SQLite file the number is exact: what another process has stored changes it, too. Of PostgreSQL it knows of
    this process and of what `note` is called for. May be shared by threads.
    """

    def __init__(self, engine: Engine) -> None:
        self._lock = Lock()
        self._number = 0
        self._counts = False
        self._committing = False
        file = engine.url.database if engine.dialect.name == "sqlite" else None
        self._watch = _FileWatch(file) if file else None
        event.listen(engine, "after_cursor_execute", self._executed)

    @property
    def exact(self) -> bool:
        """Whether what other processes store is known at once."""
        return self._watch is not None

    def number(self) -> int | None:
        """The number now; None where it cannot be known. Takes some microseconds and waits for nobody."""
        with self._lock:
            if self._watch is not None:
                try:
                    if self._committing:
                        # What shows by now may be the writer's own or, after it, of others: in a moment it is known.
                        return None if self._watch.ahead() else self._number
                    self._number += self._watch.moved()
                except sqlite3.Error:
                    return None
            return self._number

    def note(self) -> None:
        """Another process has stored something, or may have."""
        with self._lock:
            self._number += 1

    def committing(self) -> None:
        """The transaction is about to be committed. It keeps others from storing anything until it is."""
        with self._lock:
            try:
                self._number += self._watch is not None and self._watch.moved()
            except sqlite3.Error:
                self._number += 1
            self._committing = True

    def committed(self, connection: Any) -> None:
        """The transaction of a driver's connection has ended, stored or not; call it before anybody hears of that."""
        with self._lock:
            counts, self._counts, self._committing = self._counts, False, False
            try:
                others = self._watch is not None and self._watch.explained(connection)
            except sqlite3.Error:
                others = True
            self._number += counts or others

    def close(self) -> None:
        """Watch no more."""
        with self._lock:
            if self._watch is not None:
                self._watch.close()

    def _executed(
        self, _connection: Connection, _cursor: object, _text: str, _values: object, context: Any, _many: bool
    ) -> None:
        """Note, in the writer's thread, whether a statement counts."""
        compiled = context.compiled
        if compiled is None or not isinstance(compiled.statement, UpdateBase):
            return
        unseen = isinstance(compiled.statement, Update) and context.execution_options.get("uncounted", False)
        self._counts = self._counts or (compiled.statement.table in COUNTED and not unseen)


class _FileWatch:
    """A connection to a SQLite file of its own, to which every commit of any other connection shows.

    What it has seen is explained by the writer's own commits as long as the writer's connection, to which those of
    others show alone, has seen nothing by then.
    """

    def __init__(self, file: str) -> None:
        self._connection = sqlite3.connect(file, timeout=0, isolation_level=None, check_same_thread=False)
        self._seen = _version(self._connection)
        self._writers: tuple[Any, int] = (None, 0)

    def moved(self) -> bool:
        """Whether something was committed since the last call, or since what was explained last."""
        seen, self._seen = self._seen, _version(self._connection)
        return self._seen != seen

    def ahead(self) -> bool:
        """What `moved` would say; it says so again when it is called next."""
        return self._seen != _version(self._connection)

    def explained(self, connection: Any) -> bool:
        """Take what was committed as the writer's; whether anything of others was among it."""
        # In this order: what comes between the two is seen by the second.
        self._seen = _version(self._connection)
        before, self._writers = self._writers, (connection, _version(connection))
        return before != self._writers

    def close(self) -> None:
        self._connection.close()


def _version(connection: Any) -> int:
    """A number that any commit of another connection to the file changes."""
    (number,) = connection.execute("PRAGMA data_version").fetchone()
    return int(number)

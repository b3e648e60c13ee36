"""Checkpoints of SQLite's log file, which by themselves only shorten it at a moment in which nobody reads."""

import time
from pathlib import Path

from sqlalchemy import Engine

MOST_BYTES = 64 * 2**20
"""What the log file may grow to before its readers are waited for."""
PATIENCE_MS, REST_S = 1000, 5.0
"""How long they are waited for while nobody can write, and how long it is then left."""


class Checkpoints:
    """Keeps the log file of the writer's database short; does nothing on PostgreSQL. For the writer's thread."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        embedded = engine.dialect.name == "sqlite" and engine.url.database
        self._log = Path(f"{engine.url.database}-wal") if embedded else None
        self._next = 0.0

    def care(self) -> None:
        """After a commit: empty a log file that is too long, as soon as its readers let go of it."""
        if self._log is None or time.monotonic() < self._next or not self._log.exists():
            return
        if self._log.stat().st_size <= MOST_BYTES:
            return
        connection = self._engine.raw_connection()
        try:
            cursor = connection.cursor()
            cursor.execute(f"PRAGMA busy_timeout = {PATIENCE_MS}")
            cursor.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            (busy, _, _) = cursor.fetchone() or (1, 0, 0)
            cursor.execute("PRAGMA busy_timeout = 10000")
        finally:
            connection.close()
        if busy:
            self._next = time.monotonic() + REST_S

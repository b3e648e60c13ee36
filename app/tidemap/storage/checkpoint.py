"""Checkpoints of SQLite's log file, which by themselves only shorten it at a moment in which nobody reads."""

import time
from pathlib import Path

from sqlalchemy import Engine

from tidemap.storage.gate import Gate

MAX_BYTES = 32 * 2**20
"""What the log file may grow to before its readers are waited for. The last transaction comes on top: 64 MB hold one of
half that size."""
MAX_WAIT_S = 2.0
"""How long the readers of this process are waited for while nobody can begin to read or to write: longer than any
reads that holds no more than it needs."""
FOREIGN_MS, REST_S = 100, 5.0
"""How long those of other processes, `tidemap backup` for one, are waited for, and how long the file is then left."""


class Checkpoints:
    """Keeps the log file of the writer's database short; does nothing on PostgreSQL. For the writer's thread."""

    def __init__(self, engine: Engine, gate: Gate) -> None:
        self._engine = engine
        self._gate = gate
        embedded = engine.dialect.name == "sqlite" and engine.url.database
        self._log = Path(f"{engine.url.database}-wal") if embedded else None
        self._next = 0.0

    def care(self) -> None:
        """After a commit: empty a log file that is too long, letting no reader in until those inside have left."""
        if self._log is None or time.monotonic() < self._next or _size(self._log) <= MAX_BYTES:
            return
        with self._gate.shut(MAX_WAIT_S) as empty:
            emptied = empty and self._truncate()
        if not emptied:
            self._next = time.monotonic() + REST_S

    def _truncate(self) -> bool:
        """Whether nobody was in the way."""
        connection = self._engine.raw_connection()
        try:
            cursor = connection.cursor()
            cursor.execute(f"PRAGMA busy_timeout = {FOREIGN_MS}")
            cursor.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            (busy, _, _) = cursor.fetchone() or (1, 0, 0)
            cursor.execute("PRAGMA busy_timeout = 10000")
        finally:
            connection.close()
        return not busy


def _size(path: Path) -> int:
    """Bytes of a file; 0 where there is none."""
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0

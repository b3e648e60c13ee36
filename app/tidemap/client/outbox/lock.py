"""At most one sender of an outbox at a time."""

import sqlite3
from pathlib import Path

from tidemap.client.outbox.file import BUSY, code_of, connect, explained


class SenderLock:
    """A lock among all clients and processes of this machine, which its holder's death releases.

    It is SQLite's own lock on an empty file beside the outbox, which works on every system and, other than
    that of a plain file, is inherited by no child process.
    """

    def __init__(self, path: Path) -> None:
        self._path = path.with_name(f"{path.name}-sender")
        self._db = connect(self._path, timeout_s=0)
        # Without this an interrupted holder would leave a journal behind.
        self._db.execute("PRAGMA journal_mode = MEMORY")

    def taken(self) -> bool:
        """Whether this one holds the lock, which it then does until `close`."""
        with explained(self._path):
            if not self._db.in_transaction:
                try:
                    self._db.execute("BEGIN EXCLUSIVE")
                except sqlite3.OperationalError as error:
                    if code_of(error) != BUSY:
                        raise
            return self._db.in_transaction

    def close(self) -> None:
        """Let another one send."""
        self._db.close()

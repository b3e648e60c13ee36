"""The file of an outbox: an SQLite database with a row for each batch that is not at the server yet."""

import json
import shutil
import sqlite3
import threading
import time
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tidemap.client.errors import OutboxError, OutboxFullError
from tidemap.client.outbox.file import connect, explained
from tidemap.client.plans import Scalar
from tidemap.client.posting import Batch, Queued

JOURNAL_BYTES = 4 << 20
"""The write-ahead log beside the file is cut to this after a larger transaction."""
SPARE_BYTES = 1 << 19
"""What is left free on the disk so that batches can be taken out of the file."""
PAGE_BYTES = 4096
SHRINK_PAGES = 2_500
"""Free pages (10 MB) from which on an empty file is made small again."""


@dataclass(frozen=True, slots=True)
class Kept:
    """A batch in the file; `damaged`: the bytes that came back are not those that were written."""

    id: int
    batch: Batch
    damaged: bool


@dataclass(frozen=True, slots=True)
class Pending:
    """What is still to be sent: so many batches, of so many bytes; both 0 when everything was sent.

    Of the oldest one: `since` when (Unix seconds) it waits, and `last_error`, why the last try came to nothing.
    """

    batches: int
    bytes: int
    since: float | None = None
    last_error: str | None = None


@dataclass(frozen=True, slots=True)
class Refused:
    """A batch for the location at `path` that the server does not want, with its words; kept until somebody decides.

    `created_at` in Unix seconds; `status` is the HTTP status, 0 for a batch that was damaged on the disk.
    """

    id: int
    path: str
    key: str
    measurements: int
    bytes: int
    created_at: float
    tries: int
    status: int
    error: str


class OutboxStore:
    """The batches of the outbox at `path`. May be shared between threads; others may have it open too.

    `durable`: a change is on the disk when the call returns. Otherwise a power cut may undo the last changes,
    which is harmless for what was sent: it is sent again with its key.

    All methods raise OutboxError, and have then done nothing at all.
    """

    def __init__(self, path: Path, durable: bool) -> None:
        self._path = path
        self._lock = threading.Lock()
        self._db = connect(path)
        with self._reading() as db:
            db.execute(f"PRAGMA synchronous = {'FULL' if durable else 'NORMAL'}")
            db.execute(f"PRAGMA journal_size_limit = {JOURNAL_BYTES}")

    def put(self, batches: Iterable[Batch], most_bytes: int) -> Queued:
        """Keep all of the batches. Raises OutboxFullError if the file would hold more than `most_bytes` of them."""
        count = measurements = size = 0
        with self._transaction() as db:
            held, refused = (row[0] for row in db.execute("SELECT bytes FROM held ORDER BY refused"))
            for batch in batches:
                size += len(batch.content)
                if held + refused + size > most_bytes:
                    raise OutboxFullError(
                        f"{self._path}: the outbox is full; it may hold {most_bytes} bytes and holds {held + refused}, "
                        f"{refused} of them refused by the server"
                    )
                self._see_to_the_disk(db, size)
                _insert(db, batch)
                count += 1
                measurements += batch.measurements
        return Queued(count, measurements)

    def first(self, but: Iterable[str] = ()) -> Kept | None:
        """The oldest batch that waits, of all locations but those at these paths."""
        sql = """SELECT id, path, query, content_type, content, key, measurements, checksum FROM batch
            WHERE refused IS NULL AND path NOT IN (SELECT value FROM json_each(?)) ORDER BY id LIMIT 1"""
        with self._reading() as db:
            row = db.execute(sql, [json.dumps(list(but))]).fetchone()
        if row is None:
            return None
        number, path, text, content_type, content, key, measurements, checksum = row
        query = _query_of(text)
        batch = Batch(path, query or {}, content_type, content, key, measurements)
        return Kept(number, batch, query is None or zlib.crc32(content) != checksum)

    def sent(self, number: int) -> None:
        """Forget a batch that the server has stored."""
        with self._transaction() as db:
            db.execute("DELETE FROM batch WHERE id = ?", [number])

    def split(self, number: int, parts: Iterable[Batch]) -> None:
        """Keep parts of a batch instead of it; they wait behind the others."""
        with self._transaction() as db:
            db.execute("DELETE FROM batch WHERE id = ?", [number])
            for part in parts:
                _insert(db, part)

    def failed(self, number: int, error: str) -> None:
        """Note that a batch could not be sent; it goes on waiting."""
        with self._transaction() as db:
            db.execute("UPDATE batch SET tries = tries + 1, last_error = ? WHERE id = ?", [error, number])

    def refuse(self, number: int, status: int, error: str) -> None:
        """Put aside a batch that the server has refused for good."""
        sql = "UPDATE batch SET tries = tries + 1, last_error = ?, refused = ? WHERE id = ?"
        with self._transaction() as db:
            db.execute(sql, [error, status, number])

    def refused(self) -> list[Refused]:
        """What was put aside, oldest first."""
        sql = """SELECT id, path, key, measurements, bytes, created_at, tries, refused, last_error FROM batch
            WHERE refused IS NOT NULL ORDER BY id"""
        with self._reading() as db:
            return [Refused(*row) for row in db.execute(sql)]

    def retry(self, number: int) -> None:
        """Let a refused batch wait again, in the place it had. Raises OutboxError if there is none."""
        self._decide(number, "UPDATE batch SET refused = NULL WHERE id = ? AND refused IS NOT NULL")

    def move(self, number: int, path: str) -> None:
        """Let a refused batch wait again, for the location at `path`. Raises OutboxError if there is none."""
        self._decide(number, "UPDATE batch SET refused = NULL, path = ? WHERE id = ? AND refused IS NOT NULL", path)

    def discard(self, number: int) -> None:
        """Throw a refused batch away. Raises OutboxError if there is none."""
        self._decide(number, "DELETE FROM batch WHERE id = ? AND refused IS NOT NULL")

    def pending(self) -> Pending:
        """What waits."""
        oldest = "SELECT created_at, last_error FROM batch WHERE refused IS NULL ORDER BY id LIMIT 1"
        with self._reading() as db:
            count, size = db.execute("SELECT batches, bytes FROM held WHERE refused = 0").fetchone()
            return Pending(count, size, *(db.execute(oldest).fetchone() or ()))

    def tidy(self) -> None:
        """Bring what the log holds into the file, so that the log begins anew: on a full disk this makes room."""
        with self._reading() as db:
            db.execute("PRAGMA wal_checkpoint").fetchone()

    def shrink(self) -> None:
        """Give the disk back what an outbox that was full does not need any more."""
        with self._reading() as db:
            free = db.execute("PRAGMA freelist_count").fetchone()[0]
            if free >= SHRINK_PAGES and db.execute("SELECT sum(batches) FROM held").fetchone() == (0,):
                db.execute("VACUUM")
                db.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._db.close()

    def _see_to_the_disk(self, db: sqlite3.Connection, size: int) -> None:
        """Raise OutboxError unless `size` bytes may be written and the disk still be emptied of them.

        To take a batch out SQLite needs room in the log, which it gets by bringing all that the log holds into the
        file. On a disk filled to the last byte it could do neither, and the outbox could never be emptied.
        """
        log = Path(f"{self._path}-wal")
        to_come = size + (log.stat().st_size if log.exists() else 0)
        room = PAGE_BYTES * int(db.execute("PRAGMA freelist_count").fetchone()[0])
        needed = size + max(0, to_come - room) + SPARE_BYTES
        if shutil.disk_usage(self._path.parent).free < needed:
            raise OutboxError(f"{self._path}: the disk is full; {needed} bytes must be free, for work on the file too")

    def _decide(self, number: int, sql: str, *values: str) -> None:
        with self._transaction() as db:
            if db.execute(sql, [*values, number]).rowcount == 0:
                raise OutboxError(f"{self._path}: no refused batch has the id {number}")

    @contextmanager
    def _reading(self) -> Iterator[sqlite3.Connection]:
        with self._lock, explained(self._path):
            yield self._db

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        """All of the block or nothing."""
        with self._reading() as db:
            db.execute("BEGIN IMMEDIATE")
            try:
                yield db
                db.execute("COMMIT")
            finally:
                # Some errors, such as a full disk, have SQLite roll back by itself.
                if db.in_transaction:
                    db.execute("ROLLBACK")


def _query_of(text: str) -> dict[str, Scalar] | None:
    """The query of a batch, None where it is not what was written."""
    try:
        query = json.loads(text)
    except ValueError:
        return None
    return query if isinstance(query, dict) else None


def _insert(db: sqlite3.Connection, batch: Batch) -> None:
    row = {
        "path": batch.path,
        "query": json.dumps(dict(batch.query)),
        "content_type": batch.content_type,
        "key": batch.key,
        "measurements": batch.measurements,
        "bytes": len(batch.content),
        "created_at": time.time(),
        "checksum": zlib.crc32(batch.content),
        "content": batch.content,
    }
    db.execute(
        """INSERT INTO batch (path, query, content_type, key, measurements, bytes, created_at, checksum, content)
        VALUES (:path, :query, :content_type, :key, :measurements, :bytes, :created_at, :checksum, :content)""",
        row,
    )

"""Opening the files of an outbox, and saying in words what is wrong with them."""

import sqlite3
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from tidemap.client.errors import OutboxError

APPLICATION = 0x544D4F42
"""'TMOB': how this file and no other begins."""
VERSION = 1
LOCKED_S = 30.0
"""How long one process waits for another's transaction."""
CHECKED_PAGES = 16_384
"""Files of up to 64 MB are read whole when they are opened, to find damage early."""

BUSY, READONLY, IOERR, CORRUPT, FULL, CANTOPEN, NOTADB = 5, 8, 10, 11, 13, 14, 26
"""SQLite's primary result codes."""
WORDS = {
    FULL: "the disk is full",
    NOTADB: "this is no outbox but another file",
    CORRUPT: "the file is damaged",
    CANTOPEN: "it cannot be opened; see that its folder exists and may be written to",
    READONLY: "it may not be written to",
    BUSY: "another process keeps it locked",
    IOERR: "the disk does not read or write, or is full",
}
MESSAGES = {
    "database is locked": BUSY,
    "attempt to write a readonly database": READONLY,
    "disk I/O error": IOERR,
    "database disk image is malformed": CORRUPT,
    "database or disk is full": FULL,
    "unable to open database file": CANTOPEN,
    "file is not a database": NOTADB,
}
"""SQLite's own words for them: before Python 3.11 an error carries no code."""

SCHEMA = """
CREATE TABLE batch (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    path TEXT NOT NULL,
    query TEXT NOT NULL,
    content_type TEXT NOT NULL,
    key TEXT NOT NULL,
    measurements INTEGER NOT NULL,
    bytes INTEGER NOT NULL,
    created_at REAL NOT NULL,
    tries INTEGER NOT NULL DEFAULT 0,
    last_error TEXT,
    refused INTEGER,
    checksum INTEGER NOT NULL,
    content BLOB NOT NULL
);
CREATE INDEX waiting ON batch (id, path) WHERE refused IS NULL;
CREATE INDEX put_aside ON batch (id) WHERE refused IS NOT NULL;
CREATE TABLE held (refused INTEGER PRIMARY KEY, batches INTEGER NOT NULL, bytes INTEGER NOT NULL);
INSERT INTO held VALUES (0, 0, 0), (1, 0, 0);
CREATE TRIGGER comes AFTER INSERT ON batch BEGIN
    UPDATE held SET batches = batches + 1, bytes = bytes + NEW.bytes WHERE refused = (NEW.refused IS NOT NULL);
END;
CREATE TRIGGER goes AFTER DELETE ON batch BEGIN
    UPDATE held SET batches = batches - 1, bytes = bytes - OLD.bytes WHERE refused = (OLD.refused IS NOT NULL);
END;
CREATE TRIGGER changes AFTER UPDATE OF refused ON batch BEGIN
    UPDATE held SET batches = batches - 1, bytes = bytes - OLD.bytes WHERE refused = (OLD.refused IS NOT NULL);
    UPDATE held SET batches = batches + 1, bytes = bytes + NEW.bytes WHERE refused = (NEW.refused IS NOT NULL);
END;
"""
"""`held` counts what is waiting (refused 0) and what is refused (1), so that nobody has to."""


def code_of(error: BaseException | None) -> int:
    """SQLite's primary result code of an error, 0 where it has none.

    >>> code_of(sqlite3.OperationalError("database is locked")) == BUSY
    True
    """
    code: int | None = getattr(error, "sqlite_errorcode", None)
    return MESSAGES.get(str(error), 0) if code is None else code & 0xFF


@contextmanager
def explained(path: Path) -> Iterator[None]:
    """Turns SQLite's errors into OutboxError."""
    try:
        yield
    except sqlite3.Error as error:
        raise OutboxError(f"{path}: {WORDS.get(code_of(error), 'the outbox failed')} ({error})") from error


def connect(path: Path, timeout_s: float = LOCKED_S) -> sqlite3.Connection:
    """A connection for any thread, without implicit transactions. Raises OutboxError."""
    with explained(path):
        # As a URI, for the names that SQLite otherwise takes for something else, such as ':memory:'.
        uri = path.absolute().as_uri()
        return sqlite3.connect(uri, uri=True, timeout=timeout_s, isolation_level=None, check_same_thread=False)


def prepare(path: Path) -> None:
    """See that there is an outbox at `path`; make one if there is nothing. Raises OutboxError."""
    deadline = time.monotonic() + LOCKED_S
    while True:
        try:
            with closing(connect(path)) as db, explained(path):
                return _prepare(path, db)
        except OutboxError as error:
            # Another process is just making it: that locks in ways that SQLite does not wait for.
            if code_of(error.__cause__) != BUSY:
                raise
            if time.monotonic() > deadline:
                raise
            time.sleep(0.02)


def _prepare(path: Path, db: sqlite3.Connection) -> None:
    if _number(db, "application_id") == 0 and _number(db, "schema_version") == 0:
        _make(db)
    if _number(db, "application_id") != APPLICATION:
        raise OutboxError(f"{path}: this is no outbox but another program's database")
    if (version := _number(db, "user_version")) != VERSION:
        raise OutboxError(f"{path}: this outbox has the form {version}, and this client knows {VERSION}")
    if _pragma(db, "journal_mode") != "wal":
        raise OutboxError(f"{path}: an outbox needs a local disk; this file system has no shared memory")
    if _number(db, "page_count") <= CHECKED_PAGES and (found := _pragma(db, "integrity_check(1)")) != "ok":
        raise OutboxError(f"{path}: the file is damaged ({found})")


def _make(db: sqlite3.Connection) -> None:
    try:
        db.execute("PRAGMA page_size = 4096")
        db.execute("PRAGMA journal_mode = WAL")
        mark = f"PRAGMA application_id = {APPLICATION}; PRAGMA user_version = {VERSION}"
        db.executescript(f"BEGIN EXCLUSIVE; {SCHEMA} {mark}; COMMIT")
    except sqlite3.OperationalError:
        # It is there: another process was faster.
        if db.in_transaction:
            db.execute("ROLLBACK")
        if _number(db, "schema_version") == 0:
            raise


def _pragma(db: sqlite3.Connection, name: str) -> object:
    value: object = db.execute(f"PRAGMA {name}").fetchone()[0]
    return value


def _number(db: sqlite3.Connection, name: str) -> int:
    return int(str(_pragma(db, name)))

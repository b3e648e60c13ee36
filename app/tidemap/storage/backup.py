"""Backup of an embedded database: a whole, consistent copy of one moment, taken while a server goes on writing."""

import os
import shlex
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from urllib.parse import quote

from sqlalchemy import URL, make_url

from tidemap.errors import BackupError
from tidemap.storage.engine import open_inspector
from tidemap.storage.migrate import current_version
from tidemap.storage.store import usable

PAGES = 4096
"""Pages copied at once."""


def dump_command(url: str, file: Path) -> str | None:
    """The command that backs up a PostgreSQL database, without its password; None where the database is SQLite."""
    address = make_url(url)
    if address.get_backend_name() == "sqlite":
        return None
    parts = (address.username, None, address.host, address.port, address.database, address.query)
    plain = URL.create("postgresql", *parts).render_as_string()
    return shlex.join(["pg_dump", "--format=custom", f"--file={file}", f"--dbname={plain}"])


def back_up(url: str, file: Path, progress: Callable[[int, int], None]) -> None:
    """Copy the SQLite database at `url` to `file`, which appears once it is whole and durable.

    `progress` hears of the pages that are copied and of how many there are. The copy shows the moment at which this
    began. Meanwhile nobody waits, and the database's `-wal` file keeps what is written.
    Raises BackupError, DatabaseUnusableError, OSError; nothing is left behind then.
    """
    _refuse_foreign(url)
    source = Path(make_url(url).database or "")
    partial = file.with_name(f".{file.name}.{os.getpid()}.partial")
    try:
        _copy(source, partial, progress)
        shutil.copymode(source, partial)
        _sync(partial)
        partial.replace(file)
        _sync(file.parent)
    except sqlite3.Error as error:
        raise BackupError(f"The database {source} cannot be copied to {file}: {error}.") from error
    finally:
        for left in (partial, Path(f"{partial}-journal"), Path(f"{partial}-wal"), Path(f"{partial}-shm")):
            left.unlink(missing_ok=True)


def _refuse_foreign(url: str) -> None:
    """Whatever its schema version: before an upgrade is when a copy is wanted most."""
    with usable(url), open_inspector(url).connect() as connection:
        if current_version(connection) is None:
            raise BackupError(f"{make_url(url).database} holds no Tidemap database.")


def _copy(source: Path, target: Path, progress: Callable[[int, int], None]) -> None:
    with (
        closing(sqlite3.connect(f"file:{quote(str(source))}?mode=ro", uri=True, isolation_level=None)) as reader,
        closing(sqlite3.connect(target, isolation_level=None)) as writer,
    ):
        # Made durable as a whole when it is complete.
        writer.execute("PRAGMA synchronous = OFF")
        # One transaction around all steps: without it every write of the server begins the copy anew.
        reader.execute("BEGIN")
        reader.execute("SELECT 1 FROM sqlite_master LIMIT 1").fetchall()
        reader.backup(writer, pages=PAGES, progress=lambda _, left, total: progress(total - left, total))


def _sync(path: Path) -> None:
    """Make a file, or what a folder lists, durable."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)

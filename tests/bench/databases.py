"""Databases for the figures: SQLite on disk and a PostgreSQL that waits for the disk, as in earnest."""

import sqlite3
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import psycopg

from tests.support.databases import migrate_to_head
from tests.support.postgres import running_postgres

Insert = Callable[[Sequence[bytes]], None]
"""Stores some blobs in one durable commit."""
OpenDatabase = Callable[[], AbstractContextManager[str]]
OpenRaw = Callable[[str], AbstractContextManager[Insert]]
TABLE = "CREATE TABLE raw (id INTEGER PRIMARY KEY, payload {blob} NOT NULL)"


@contextmanager
def sqlite() -> Iterator[str]:
    """The URL of a migrated file in a folder of its own."""
    with tempfile.TemporaryDirectory(prefix="tidemap-bench-") as folder:
        url = f"sqlite:///{Path(folder) / 'tidemap.db'}"
        migrate_to_head(url)
        yield url


@contextmanager
def postgres() -> Iterator[str]:
    """The URL of a migrated database of a server of its own, with PostgreSQL's own, durable settings."""
    with running_postgres({}) as server:
        url = server.url(server.create())
        migrate_to_head(url)
        yield url


@contextmanager
def raw_sqlite(url: str) -> Iterator[Insert]:
    """The plainest way into a file beside that of `url`: WAL, synchronous FULL, as the service has it."""
    connection = sqlite3.connect(url.removeprefix("sqlite:///") + ".raw", isolation_level=None)
    for statement in ("PRAGMA journal_mode = WAL", "PRAGMA synchronous = FULL", TABLE.format(blob="BLOB")):
        connection.execute(statement)

    def insert(payloads: Sequence[bytes]) -> None:
        connection.execute("BEGIN IMMEDIATE")
        for payload in payloads:
            connection.execute("INSERT INTO raw (payload) VALUES (?)", (payload,))
        connection.execute("COMMIT")

    yield insert
    connection.close()


@contextmanager
def raw_postgres(url: str) -> Iterator[Insert]:
    """The plainest way into the same server: psycopg, one statement a blob."""
    with psycopg.connect(url.replace("postgresql+psycopg", "postgresql")) as connection:
        connection.execute(TABLE.format(blob="BYTEA").replace("INTEGER", "SERIAL").encode())
        connection.commit()

        def insert(payloads: Sequence[bytes]) -> None:
            for payload in payloads:
                connection.execute("INSERT INTO raw (payload) VALUES (%b)", (payload,))
            connection.commit()

        yield insert

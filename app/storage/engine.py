"""Database engines: SQLite with WAL, immediate writes and full synchronisation, or PostgreSQL through psycopg 3."""

from pathlib import Path
from typing import Any

from sqlalchemy import URL, Connection, Engine, create_engine, event, make_url
from sqlalchemy.pool import QueuePool

_PRAGMAS = (
    "PRAGMA journal_mode = WAL",
    "PRAGMA synchronous = FULL",
    "PRAGMA foreign_keys = ON",
    "PRAGMA busy_timeout = 10000",
)


def open_reader(url: str) -> Engine:
    """An engine for reading: many connections, each transaction sees one snapshot."""
    parsed = make_url(url)
    if parsed.get_backend_name() == "sqlite":
        return _sqlite(parsed, begin="BEGIN", pool_size=16)
    return create_engine(parsed, pool_pre_ping=True, pool_size=16, isolation_level="REPEATABLE READ")


def open_writer(url: str) -> Engine:
    """An engine for the one writer of this process."""
    parsed = make_url(url)
    if parsed.get_backend_name() == "sqlite":
        return _sqlite(parsed, begin="BEGIN IMMEDIATE", pool_size=1)
    return create_engine(parsed, pool_pre_ping=True, pool_size=2)


def _sqlite(url: URL, begin: str, pool_size: int) -> Engine:
    if url.database:
        Path(url.database).parent.mkdir(parents=True, exist_ok=True)
    engine = create_engine(
        url,
        poolclass=QueuePool,
        pool_size=pool_size,
        max_overflow=32,
        connect_args={"check_same_thread": False},
    )

    @event.listens_for(engine, "connect")
    def _prepare(connection: Any, _record: object) -> None:
        # The driver's own transactions are off: they begin deferred, and writers then fail 'database is locked'.
        connection.isolation_level = None
        for pragma in _PRAGMAS:
            connection.execute(pragma)

    @event.listens_for(engine, "begin")
    def _begin(connection: Connection) -> None:
        connection.exec_driver_sql(begin)

    return engine

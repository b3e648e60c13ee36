"""Database engines: SQLite with WAL, immediate writes and full synchronisation, or PostgreSQL through psycopg 3."""

import sqlite3
from pathlib import Path
from typing import Any
from urllib.parse import quote

from sqlalchemy import URL, Connection, Engine, create_engine, event, make_url
from sqlalchemy.pool import NullPool, QueuePool

PAGE_BYTES = 4096
"""Of a new file. Smaller ones would leave less of a small file empty, but a full disk has to have no room for the least
write either: only so the log tells of it once."""
_PRAGMAS = (
    "PRAGMA journal_mode = WAL",
    "PRAGMA synchronous = FULL",
    "PRAGMA foreign_keys = ON",
    "PRAGMA busy_timeout = 10000",
    f"PRAGMA wal_autocheckpoint = {4 * 2**20 // PAGE_BYTES}",
)
OVERFLOW = 32
"""Connections beyond those kept, so that none of the 40 requests that run at once waits for one."""
GIVEN_UP_S = 15
"""How long PostgreSQL keeps what a process holds that is frozen, or has vanished with its machine."""
WATCH_S = 5
"""How long a watch, which tries again each second, waits for a connection and for a row's lock."""


def open_reader(url: str) -> Engine:
    """An engine for reading: many connections, each transaction sees one snapshot."""
    parsed = make_url(url)
    if parsed.get_backend_name() == "sqlite":
        return _sqlite(parsed, begin="BEGIN", pool_size=16)
    how = {"pool_pre_ping": True, "pool_size": 16, "max_overflow": OVERFLOW, "isolation_level": "REPEATABLE READ"}
    return create_engine(parsed, **how)


def open_writer(url: str) -> Engine:
    """An engine for the one writer of this process, which ends every transaction itself: nothing is to be reset."""
    parsed = make_url(url)
    if parsed.get_backend_name() == "sqlite":
        return _sqlite(parsed, begin="BEGIN IMMEDIATE", pool_size=1, pool_reset_on_return=None)
    engine = create_engine(parsed, pool_pre_ping=True, pool_size=2, pool_reset_on_return=None)
    return _set(engine, idle_in_transaction_session_timeout=GIVEN_UP_S)


def open_watch(url: str) -> Engine:
    """An engine of PostgreSQL for a connection that is used every second, so that both ends notice when it is lost."""
    timeouts = {"connect_timeout": WATCH_S, "tcp_user_timeout": GIVEN_UP_S * 1000}
    engine = create_engine(url, poolclass=NullPool, isolation_level="AUTOCOMMIT", connect_args=timeouts)
    return _set(engine, idle_session_timeout=GIVEN_UP_S, lock_timeout=WATCH_S)


def _set(engine: Engine, **seconds: int) -> Engine:
    """Have PostgreSQL end every connection of an engine after so long."""

    @event.listens_for(engine, "connect")
    def _prepare(connection: Any, _record: object) -> None:
        for name, value in seconds.items():
            connection.execute(f"SET {name} = '{value}s'")
        connection.commit()

    return engine


def open_inspector(url: str) -> Engine:
    """An engine that cannot write, for looking at a database that a server may be using; a SQLite file must exist."""
    parsed = make_url(url)
    if parsed.get_backend_name() != "sqlite":
        reading = {"isolation_level": "REPEATABLE READ", "postgresql_readonly": True}
        return create_engine(parsed, poolclass=NullPool).execution_options(**reading)
    address = f"file:{quote(parsed.database or '')}?mode=ro"

    def connect() -> sqlite3.Connection:
        return sqlite3.connect(address, uri=True, isolation_level=None, timeout=10, check_same_thread=False)

    engine = create_engine("sqlite://", creator=connect, poolclass=NullPool)
    event.listen(engine, "begin", lambda connection: connection.exec_driver_sql("BEGIN"))
    return engine


def _sqlite(url: URL, begin: str, pool_size: int, **how: Any) -> Engine:
    if url.database:
        Path(url.database).parent.mkdir(parents=True, exist_ok=True)
    engine = create_engine(
        url,
        poolclass=QueuePool,
        pool_size=pool_size,
        max_overflow=OVERFLOW,
        connect_args={"check_same_thread": False},
        **how,
    )

    @event.listens_for(engine, "connect")
    def _prepare(connection: Any, _record: object) -> None:
        # The driver's own transactions are off: they begin deferred, and writers then fail 'database is locked'.
        connection.isolation_level = None
        if connection.execute("PRAGMA page_count").fetchone() == (0,):
            # Before everything else, and it would ask a file that is in use for a lock.
            connection.execute(f"PRAGMA page_size = {PAGE_BYTES}")
            connection.execute("PRAGMA auto_vacuum = INCREMENTAL")
        for pragma in _PRAGMAS:
            connection.execute(pragma)

    @event.listens_for(engine, "begin")
    def _begin(connection: Connection) -> None:
        connection.exec_driver_sql(begin)

    return engine

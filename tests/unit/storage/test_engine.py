"""SQLite is opened as it must be: everything reaches the disk, and writers wait for each other."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from sqlalchemy import Engine, insert, select, text
from sqlalchemy.exc import IntegrityError

from tidemap.errors import SchemaVersionError
from tidemap.storage.engine import open_reader, open_writer
from tidemap.storage.store import Store, migrate_database
from tidemap.storage.tables import api_key, observation


def pragma(engine: Engine, name: str) -> object:
    with engine.connect() as connection:
        return connection.execute(text(f"PRAGMA {name}")).scalar()


@pytest.mark.parametrize("open_", [open_reader, open_writer])
def test_every_connection_is_set_up(database_url: str, open_: Callable[[str], Engine]) -> None:
    engine = open_(database_url)
    full, on = 2, 1
    for name, value in (("journal_mode", "wal"), ("synchronous", full), ("foreign_keys", on), ("busy_timeout", 10_000)):
        assert pragma(engine, name) == value
    engine.dispose()


def test_a_row_without_its_location_is_refused(database_url: str) -> None:
    engine = open_writer(database_url)
    row = {"location_id": 9, "id": 1, "received_at": 0.0, "measurements": 1, "first_time": 0.0, "last_time": 0.0}
    with pytest.raises(IntegrityError, match="FOREIGN KEY"), engine.begin() as connection:
        connection.execute(insert(observation).values(**row))
    engine.dispose()


def test_writers_of_several_processes_wait_for_each_other(database_url: str) -> None:
    """With a plain BEGIN most of these would fail: 'database is locked'."""
    engines = [open_writer(database_url) for _ in range(4)]

    def write(n: int) -> None:
        with engines[n % 4].begin() as connection:
            seen = len(connection.execute(select(api_key.c.id)).all())
            row = {"name": f"{seen}", "role": "robot", "prefix": "tm_", "hash": b"%d" % n, "created_at": 1.0}
            connection.execute(insert(api_key).values(**row))

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(write, range(60)))
    with engines[0].connect() as connection:
        names = connection.execute(select(api_key.c.name).order_by(api_key.c.id)).scalars().all()
    assert names == [str(n) for n in range(60)], "each saw all that were before it"
    for engine in engines:
        engine.dispose()


def test_the_folder_of_the_database_is_made(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path}/some/where/tidemap.db"
    migrate_database(url)
    Store(url).close()


def test_a_store_that_cannot_be_opened_keeps_no_connection(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened = []

    def watched(url: str) -> Engine:
        opened.append(open_reader(url))
        return opened[-1]

    monkeypatch.setattr("tidemap.storage.store.open_reader", watched)
    with pytest.raises(SchemaVersionError):
        Store(f"sqlite:///{tmp_path}/tidemap.db")
    assert [engine.pool.checkedin() for engine in opened] == [0]  # type: ignore[attr-defined]

"""The schema: what the migrations make is what the code expects, and nothing unknown is touched."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext
from sqlalchemy import Connection, create_mock_engine, insert, inspect, select, text, update

from tidemap.errors import DatabaseUnusableError, SchemaVersionError
from tidemap.storage.engine import open_writer
from tidemap.storage.partitions import is_partition
from tidemap.storage.store import Store, check_server, migrate_database, prepare_database
from tidemap.storage.tables import api_key, metadata

KEY = {"name": "door", "role": "robot", "prefix": "tm_", "hash": b"h", "created_at": 1.0}


@contextmanager
def writing(url: str) -> Iterator[Connection]:
    engine = open_writer(url)
    with engine.begin() as connection:
        yield connection
    engine.dispose()


def whole_table(name: str | None, kind: str, _parents: object) -> bool:
    return kind != "table" or not is_partition(name)


def test_from_nothing_to_everything(empty_database_url: str) -> None:
    with pytest.raises(SchemaVersionError, match=r"schema version none.*tidemap migrate"):
        Store(empty_database_url)
    migrate_database(empty_database_url)
    with writing(empty_database_url) as connection:
        found = {name for name in inspect(connection).get_table_names() if not is_partition(name)}
        assert found == {*metadata.tables, "alembic_version"}
    Store(empty_database_url).close()


def test_the_migrations_make_the_tables_of_the_code(database_url: str) -> None:
    with writing(database_url) as connection:
        options = {"compare_type": True, "compare_server_default": True, "include_name": whole_table}
        assert compare_metadata(MigrationContext.configure(connection, opts=options), metadata) == []


@pytest.mark.parametrize("again", [migrate_database, prepare_database])
def test_migrating_again_changes_nothing(database_url: str, again: Callable[[str], None]) -> None:
    with writing(database_url) as connection:
        connection.execute(insert(api_key).values(**KEY))
    again(database_url)
    with writing(database_url) as connection:
        assert connection.execute(select(api_key.c.name)).scalars().all() == ["door"]


def test_a_server_prepares_an_empty_database(empty_database_url: str) -> None:
    prepare_database(empty_database_url)
    Store(empty_database_url).close()


@pytest.mark.parametrize("open_", [migrate_database, prepare_database, Store])
def test_the_schema_of_a_newer_version_is_refused(database_url: str, open_: Callable[[str], object]) -> None:
    with writing(database_url) as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
        connection.execute(insert(api_key).values(**KEY))
    with pytest.raises(SchemaVersionError, match=r"9999.*newer version.*nothing was changed"):
        open_(database_url)
    with writing(database_url) as connection:
        assert connection.execute(text("SELECT version_num FROM alembic_version")).scalar() == "9999"
        assert connection.execute(update(api_key).values(name="gate")).rowcount == 1


def test_a_postgresql_that_is_too_old_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    dialect = create_mock_engine("postgresql+psycopg://", lambda *_: None).dialect
    for version in ((14, 0), (17, 2), None):
        monkeypatch.setattr(dialect, "server_version_info", version, raising=False)
        check_server(dialect)
    monkeypatch.setattr(dialect, "server_version_info", (13, 9), raising=False)
    with pytest.raises(DatabaseUnusableError, match=r"This is PostgreSQL 13\.9; use 14 or newer\."):
        check_server(dialect)

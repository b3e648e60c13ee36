"""A context on a fresh SQLite database; what differs between databases is tested in tests/db."""

from collections.abc import Iterator

import pytest

from tests.support.contexts import Clock, opened
from tests.support.databases import SqliteDatabases
from tidemap.services.context import Context


@pytest.fixture(scope="session")
def sqlite_databases(tmp_path_factory: pytest.TempPathFactory) -> SqliteDatabases:
    """Makes SQLite databases."""
    return SqliteDatabases(tmp_path_factory.mktemp("unit"))


@pytest.fixture
def sqlite_url(sqlite_databases: SqliteDatabases) -> Iterator[str]:
    """The URL of a fresh SQLite database with the current schema."""
    with sqlite_databases.migrated() as url:
        yield url


@pytest.fixture
def clock() -> Clock:
    """The time of `ctx`."""
    return Clock()


@pytest.fixture
def ctx(sqlite_url: str, clock: Clock) -> Iterator[Context]:
    """An open context."""
    with opened(sqlite_url, clock) as context:
        yield context

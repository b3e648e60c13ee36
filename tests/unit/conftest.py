"""Fresh databases are SQLite here; what differs between databases is tested in tests/db."""

import pytest

from tests.support.databases import Databases, SqliteDatabases


@pytest.fixture(scope="session")
def databases(tmp_path_factory: pytest.TempPathFactory) -> Databases:
    """Makes SQLite databases."""
    return SqliteDatabases(tmp_path_factory.mktemp("databases"))

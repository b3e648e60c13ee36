"""The databases that tests get are what they are said to be, on both kinds."""

from sqlalchemy import text

from tests.support.databases import Databases
from tidemap.storage.engine import open_reader, open_writer
from tidemap.storage.migrate import check_version, current_version


def test_a_migrated_database_has_the_current_schema(database_url: str) -> None:
    engine = open_reader(database_url)
    with engine.connect() as connection:
        check_version(connection)
    engine.dispose()


def test_an_empty_database_has_none(empty_database_url: str) -> None:
    engine = open_reader(empty_database_url)
    with engine.connect() as connection:
        assert current_version(connection) is None
    engine.dispose()


def test_databases_do_not_share_anything(databases: Databases) -> None:
    with databases.migrated() as first, databases.migrated() as second:
        writer, reader = open_writer(first), open_reader(second)
        with writer.begin() as connection:
            connection.execute(text("CREATE TABLE only_here (id INTEGER)"))
        with reader.connect() as connection:
            assert not reader.dialect.has_table(connection, "only_here")
        writer.dispose()
        reader.dispose()

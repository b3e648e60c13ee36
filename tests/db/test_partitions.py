"""Partitions on PostgreSQL: new databases have them, old ones get them, and nothing of what they hold changes."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from sqlalchemy import Connection, text

from tests.support.contexts import make_location, opened, post_states, refit
from tests.support.databases import PostgresDatabases
from tests.support.postgres import Postgres
from tests.support.version_before import make_version_before
from tidemap.cli import main
from tidemap.errors import DatabaseUnusableError
from tidemap.services.state import StateQuery, state_at
from tidemap.services.verify import Finding, verify
from tidemap.storage.engine import open_writer
from tidemap.storage.partitions import GROWING, PARTITIONS, unpartitioned
from tidemap.storage.store import migrate_database, partition_database
from tidemap.storage.tables import metadata

OWNED = sorted(table.name for table in metadata.sorted_tables if "location_id" in table.c)
KEYS = """
SELECT conrelid::regclass::text AS owner, contype::text, a.attname AS first
FROM pg_constraint JOIN pg_attribute a ON a.attrelid = conrelid AND a.attnum = conkey[1]
WHERE contype IN ('p', 'f', 'u') AND conrelid::regclass::text = ANY(:tables)
"""
UNIQUE = """
SELECT indrelid::regclass::text AS owner, a.attname AS first
FROM pg_index JOIN pg_attribute a ON a.attrelid = indrelid AND a.attnum = indkey[0]
WHERE indisunique AND indrelid::regclass::text = ANY(:tables)
"""
PARTS = "SELECT inhparent::regclass::text AS owner, count(*) FROM pg_inherits GROUP BY 1"


@contextmanager
def connected(url: str) -> Iterator[Connection]:
    engine = open_writer(url)
    with engine.begin() as connection:
        yield connection
    engine.dispose()


@pytest.fixture
def old(postgres: Postgres, tmp_path: Path) -> Iterator[str]:
    """A database that an earlier version filled, as `tidemap migrate` leaves it."""
    with PostgresDatabases(postgres).empty() as url:
        make_version_before(url, tmp_path)
        migrate_database(url)
        yield url


def parts(url: str) -> dict[str, int]:
    """How many partitions the growing tables have."""
    with connected(url) as connection:
        found = {owner: int(n) for owner, n in connection.execute(text(PARTS))}
    return {table: found.get(table, 0) for table in GROWING}


def findings(url: str) -> list[Finding]:
    found: list[Finding] = []
    verify(url, found.append)
    return found


def test_every_key_begins_with_the_location(postgres: Postgres) -> None:
    with PostgresDatabases(postgres).migrated() as url, connected(url) as connection:
        keys = connection.execute(text(KEYS), {"tables": OWNED}).all()
        unique = connection.execute(text(UNIQUE), {"tables": OWNED}).all()
    assert {row.owner for row in keys if row.contype == "p"} == set(OWNED)
    assert {row.owner for row in keys if row.contype == "f"} == set(OWNED)
    assert {row.first for row in [*keys, *unique]} == {"location_id"}


def test_a_new_database_is_partitioned(postgres: Postgres) -> None:
    with PostgresDatabases(postgres).migrated() as url:
        assert parts(url) == dict.fromkeys(GROWING, PARTITIONS)
        with opened(url) as ctx:
            for name in map(str, range(6)):
                make_location(ctx, name, estimator="static")
                post_states(ctx, name, [0.0, 60.0], [0, 1])
                refit(ctx, name)
        with connected(url) as connection:
            rows = connection.execute(text("SELECT count(DISTINCT tableoid) FROM spectrum")).scalar_one()
        assert rows > 1
        assert findings(url) == []


def test_an_old_one_goes_on_where_it_was_interrupted(old: str) -> None:
    with opened(old) as ctx:
        before = state_at(ctx, "lab", StateQuery(0.0)).probability.tolist()
    assert parts(old) == dict.fromkeys(GROWING, 0)

    def interrupt(table: str) -> None:
        if table == GROWING[2]:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        partition_database(old, interrupt)
    assert [table for table, n in parts(old).items() if n] == list(GROWING[:2])
    assert main(["migrate", "--partition", "--database-url", old]) == 0
    assert parts(old) == dict.fromkeys(GROWING, PARTITIONS)
    with connected(old) as connection:
        assert unpartitioned(connection) == []
    assert findings(old) == []
    with opened(old) as ctx:
        assert state_at(ctx, "lab", StateQuery(0.0)).probability.tolist() == before
        assert refit(ctx, "lab").revision == 2


def test_partitions_have_the_indexes_and_keys_of_what_was_there(postgres: Postgres, old: str) -> None:
    partition_database(old, lambda table: None)
    listed = "SELECT indexdef FROM pg_indexes WHERE tablename = ANY(:tables) ORDER BY 1"
    with PostgresDatabases(postgres).migrated() as new, connected(new) as made, connected(old) as brought:
        for question in (listed, KEYS, UNIQUE):
            answers = [
                sorted(map(tuple, each.execute(text(question), {"tables": list(GROWING)}))) for each in (made, brought)
            ]
            assert answers[0] == answers[1]


def test_sqlite_has_none(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'tidemap.db'}"
    migrate_database(url)
    with pytest.raises(DatabaseUnusableError, match="leave --partition out"):
        partition_database(url, lambda table: None)

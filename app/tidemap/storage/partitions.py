"""Partitions: on PostgreSQL the tables that grow lie in several, by the hash of `location_id`."""

from collections.abc import Iterator
from typing import Final

from sqlalchemy import Connection, text

GROWING: Final = ("observation", "scan", "history", "spectrum", "anomaly")
"""The tables that grow with what is measured."""
PARTITIONS: Final = 8
"""Of each. More would slow down what asks all of them, and every new connection."""


def has_locations(connection: Connection) -> bool:
    """Whether there is anything that belongs to one."""
    return connection.execute(text("SELECT 1 FROM location LIMIT 1")).first() is not None


def unpartitioned(connection: Connection) -> list[str]:
    """The growing tables that lie in one piece."""
    rows = connection.execute(_KINDS, {"tables": list(GROWING)})
    return sorted((row.relname for row in rows if row.relkind == "r"), key=GROWING.index)


def is_partition(name: str | None) -> bool:
    """Whether a table is a part of another.

    >>> is_partition("history_p3"), is_partition("history")
    (True, False)
    """
    return name in {_part(table, number) for table in GROWING for number in range(PARTITIONS)}


def partition(connection: Connection, table: str) -> None:
    """Put a table with its rows, keys and indexes into partitions, in the transaction that the connection is in.

    All others who read or write it wait for the end of that; it takes the table's size of disk meanwhile.
    """
    connection.execute(text(f'LOCK TABLE "{table}" IN ACCESS EXCLUSIVE MODE'))
    # As they are stored, whatever version made them; rows are copied first, which is faster without.
    keys, indexes = list(_keys(connection, table)), list(_indexes(connection, table))
    new = f"{table}_partitioned"
    _run(connection, f'CREATE TABLE "{new}" (LIKE "{table}" INCLUDING DEFAULTS) PARTITION BY HASH (location_id)')
    for number in range(PARTITIONS):
        values = f"FOR VALUES WITH (MODULUS {PARTITIONS}, REMAINDER {number})"
        _run(connection, f'CREATE TABLE "{_part(table, number)}" PARTITION OF "{new}" {values}')
    _run(connection, f'INSERT INTO "{new}" TABLE "{table}"')
    _run(connection, f'DROP TABLE "{table}"')
    _run(connection, f'ALTER TABLE "{new}" RENAME TO "{table}"')
    for name, definition in keys:
        _run(connection, f'ALTER TABLE "{table}" ADD CONSTRAINT "{name}" {definition}')
    for definition in indexes:
        _run(connection, definition)
    _run(connection, f'ANALYZE "{table}"')


def _part(table: str, number: int) -> str:
    return f"{table}_p{number}"


def _keys(connection: Connection, table: str) -> Iterator[tuple[str, str]]:
    """Name and definition of the primary and foreign keys of a table, and of what else is constrained."""
    for row in connection.execute(_CONSTRAINTS, {"table": table}):
        yield row.conname, row.definition


def _indexes(connection: Connection, table: str) -> Iterator[str]:
    """How each index that is no key's is made."""
    for row in connection.execute(_INDEXES, {"table": table}):
        yield row.definition


def _run(connection: Connection, statement: str) -> None:
    connection.exec_driver_sql(statement)


_KINDS = text(
    "SELECT relname, relkind::text FROM pg_class "
    "WHERE relnamespace = current_schema()::regnamespace AND relname = ANY(:tables)"
)
_CONSTRAINTS = text(
    "SELECT conname, pg_get_constraintdef(oid) AS definition FROM pg_constraint "
    "WHERE conrelid = CAST(:table AS regclass) AND contype IN ('p', 'u', 'f', 'c') ORDER BY contype DESC, conname"
)
_INDEXES = text(
    "SELECT pg_get_indexdef(indexrelid) AS definition FROM pg_index "
    "WHERE indrelid = CAST(:table AS regclass) "
    "AND NOT EXISTS (SELECT 1 FROM pg_constraint WHERE conindid = indexrelid AND conrelid = indrelid) "
    "ORDER BY indexrelid"
)

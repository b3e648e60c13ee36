"""Ids that grow in the order of commits: the counter's row stays locked until the transaction ends."""

from typing import Any

from sqlalchemy import Connection
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.sql.dml import ReturningInsert

from tidemap.storage.tables import counter


def take(connection: Connection, name: str, count: int = 1) -> int:
    """Reserve `count` consecutive ids; returns the first."""
    last = connection.execute(_TAKE[connection.dialect.name], {"name": name, "value": count}).scalar_one()
    return int(last) - count + 1


def _take(first: postgresql.Insert | sqlite.Insert) -> ReturningInsert[Any]:
    further = {"value": counter.c.value + first.excluded.value}
    return first.on_conflict_do_update(index_elements=[counter.c.name], set_=further).returning(counter.c.value)


_TAKE = {"postgresql": _take(postgresql.insert(counter)), "sqlite": _take(sqlite.insert(counter))}

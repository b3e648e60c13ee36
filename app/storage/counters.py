"""Ids that grow in the order of commits: the counter's row stays locked until the transaction ends."""

from sqlalchemy import Connection
from sqlalchemy.dialects import postgresql, sqlite

from app.storage.tables import counter


def take(connection: Connection, name: str, count: int = 1) -> int:
    """Reserve `count` consecutive ids; returns the first."""
    insert = postgresql.insert if connection.dialect.name == "postgresql" else sqlite.insert
    first = insert(counter).values(name=name, value=count)
    further = first.on_conflict_do_update(index_elements=[counter.c.name], set_={"value": counter.c.value + count})
    last = connection.execute(further.returning(counter.c.value)).scalar_one()
    return int(last) - count + 1

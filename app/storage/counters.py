"""Ids that grow in the order of commits: the counter's row stays locked until the transaction ends."""

from sqlalchemy import Connection, insert, update

from app.storage.tables import counter


def take(connection: Connection, name: str, count: int = 1) -> int:
    """Reserve `count` consecutive ids; returns the first."""
    query = update(counter).where(counter.c.name == name).values(value=counter.c.value + count)
    last = connection.execute(query.returning(counter.c.value)).scalar()
    if last is None:
        connection.execute(insert(counter).values(name=name, value=count))
        last = count
    return int(last) - count + 1

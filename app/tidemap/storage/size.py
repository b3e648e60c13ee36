"""How large a database is on its disk."""

from pathlib import Path

from sqlalchemy import Connection, func, select


def database_bytes(connection: Connection) -> int:
    """The bytes of a SQLite file with the log beside it, or what PostgreSQL counts of its database."""
    if connection.dialect.name != "sqlite":
        return int(connection.execute(select(func.pg_database_size(func.current_database()))).scalar_one())
    file = connection.engine.url.database or ""
    return sum(path.stat().st_size for path in (Path(file), Path(f"{file}-wal")) if path.exists())

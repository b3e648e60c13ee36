"""A database as the version before made it, on SQLite and on PostgreSQL."""

import gzip
from pathlib import Path

from sqlalchemy import Connection, MetaData, create_engine, insert, make_url, select, text

from tests.support.paths import ROOT
from tidemap.storage.engine import open_writer
from tidemap.storage.migrate import migrate

MADE = ROOT / "tests" / "db" / "version_before.db.gz"
REVISION = "0001"
"""Its schema."""


def make_version_before(url: str, folder: Path) -> None:
    """Fill the empty database at `url`: on SQLite the file itself, on PostgreSQL its rows in the tables of its schema.

    What is in the rows, packed bytes among them, is the same on both; only the files around them differ.
    """
    file = Path(make_url(url).database or "") if url.startswith("sqlite") else folder / "made.db"
    file.write_bytes(gzip.decompress(MADE.read_bytes()))
    if url.startswith("sqlite"):
        return
    source, target = create_engine(f"sqlite:///{file}"), open_writer(url)
    with source.connect() as read, target.begin() as write:
        migrate(write, REVISION)
        _copy(read, write)
    source.dispose()
    target.dispose()


def _copy(read: Connection, write: Connection) -> None:
    """Every row, and with them the next number of a key, which PostgreSQL counts beside the rows."""
    tables = MetaData()
    tables.reflect(read)
    for table in tables.sorted_tables:
        rows = [row._asdict() for row in read.execute(select(table))]
        if table.name != "alembic_version" and rows:
            write.execute(insert(table), rows)
    write.execute(text("SELECT setval(pg_get_serial_sequence('api_key', 'id'), max(id)) FROM api_key"))

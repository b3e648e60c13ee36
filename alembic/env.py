"""Alembic's entry: runs migrations on the connection it is handed, or on TIDEMAP_DATABASE_URL from the command line."""

from alembic import context

from tidemap.settings import Settings
from tidemap.storage.engine import open_writer
from tidemap.storage.partitions import is_partition
from tidemap.storage.tables import metadata


def run(connection: object) -> None:
    """Migrate on one connection, in its transaction."""
    context.configure(
        connection=connection,
        target_metadata=metadata,
        render_as_batch=True,
        include_name=lambda name, kind, _parents: kind != "table" or not is_partition(name),
    )
    with context.begin_transaction():
        context.run_migrations()


handed = context.config.attributes.get("connection")
if handed is not None:
    run(handed)
else:
    with open_writer(Settings().url).begin() as connection:
        run(connection)

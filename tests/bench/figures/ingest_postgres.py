"""ingest_postgres: as ingest, durable on PostgreSQL, whose own processor time is not counted."""

from tests.bench import databases, ingesting
from tests.bench.timing import Figure


def measure() -> Figure:
    return ingesting.figure(databases.postgres)

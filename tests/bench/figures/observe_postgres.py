"""observe_postgres: as observe, on PostgreSQL; the same bytes by plain psycopg."""

from tests.bench import databases, observing
from tests.bench.timing import Figure


def measure() -> Figure:
    return observing.figure(databases.postgres, databases.raw_postgres)

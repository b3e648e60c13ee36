"""ingest: CPU of a server for a look of 10^4 cells by HTTP, durable on SQLite, against an empty 201 to its body."""

from tests.bench import databases, ingesting
from tests.bench.timing import Figure


def measure() -> Figure:
    return ingesting.figure(databases.sqlite)

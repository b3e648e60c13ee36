"""observe: a look of 10^4 cells from its body to its commit on SQLite, against inserting the same bytes."""

from tests.bench import databases, observing
from tests.bench.timing import Figure


def measure() -> Figure:
    return observing.figure(databases.sqlite, databases.raw_sqlite)

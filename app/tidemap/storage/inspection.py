"""Inspection: every stored row as it is, read in small portions, for checks of a database."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from sqlalchemy import Connection, Engine, Select, Table, func, select, text

from tidemap.storage.engine import open_inspector
from tidemap.storage.migrate import check_version
from tidemap.storage.store import usable
from tidemap.storage.tables import (
    anomaly,
    api_key,
    counter,
    history,
    job,
    location,
    metadata,
    observation,
    revision,
    scan,
    spectrum,
)

Row = Any
"""A row with the columns of its table as attributes."""
PORTION = 4
"""Rows held at once: each may carry a blob of megabytes."""


class Inspection:
    """A database that is looked at and not written; each snapshot sees one moment of it."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine

    @contextmanager
    def snapshot(self) -> Iterator["Snapshot"]:
        """One moment. Short ones are better: while it is looked at, SQLite's log file only grows."""
        with self._engine.connect() as connection, connection.begin() as transaction:
            yield Snapshot(connection)
            transaction.rollback()


@contextmanager
def inspect(url: str) -> Iterator[Inspection]:
    """An inspection of the database at `url`, which a server may be using.

    Raises SchemaVersionError unless it has this version's schema, DatabaseUnusableError when it cannot be opened.
    """
    engine = open_inspector(url)
    try:
        with usable(url), engine.connect() as connection:
            check_version(connection)
        yield Inspection(engine)
    finally:
        engine.dispose()


class Snapshot:
    """The rows of one moment."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def location_ids(self) -> list[int]:
        """Of all locations, ascending."""
        return list(self._connection.execute(select(location.c.id).order_by(location.c.id)).scalars())

    def location(self, location_id: int) -> Row | None:
        """Its row, None where it has been deleted."""
        return self._connection.execute(select(location).where(location.c.id == location_id)).first()

    def log(self, location_id: int) -> Iterator[Row]:
        """Its observations in the order of their numbers."""
        return self._rows(select(observation).where(observation.c.location_id == location_id).order_by("id"))

    def segments(self, location_id: int) -> Iterator[Row]:
        """Its history."""
        query = select(history).where(history.c.location_id == location_id)
        return self._rows(query.order_by(history.c.chunk, history.c.segment))

    def revisions(self, location_id: int) -> Iterator[Row]:
        """Its revisions, oldest first."""
        return self._rows(select(revision).where(revision.c.location_id == location_id).order_by("revision"))

    def spectra(self, location_id: int) -> Iterator[Row]:
        """The chunks of all its revisions."""
        query = select(spectrum).where(spectrum.c.location_id == location_id)
        return self._rows(query.order_by(spectrum.c.revision, spectrum.c.chunk))

    def anomalies(self, location_id: int) -> Iterator[Row]:
        """Its events."""
        return self._rows(select(anomaly).where(anomaly.c.location_id == location_id).order_by("id"))

    def scans(self, location_id: int) -> Iterator[Row]:
        """What became of its scans."""
        return self._rows(select(scan).where(scan.c.location_id == location_id).order_by("id"))

    def jobs(self, location_id: int) -> Iterator[Row]:
        """Its jobs."""
        return self._rows(select(job).where(job.c.location_id == location_id).order_by("id"))

    def api_keys(self) -> Iterator[Row]:
        """All API keys."""
        return self._rows(select(api_key).order_by("id"))

    def repeated_keys(self, location_id: int) -> Iterator[Row]:
        """The idempotency keys that several of its observations have, each with their `number`."""
        query = select(observation.c.idempotency_key, func.count().label("number"))
        mine = (observation.c.location_id == location_id) & observation.c.idempotency_key.is_not(None)
        return self._rows(query.where(mine).group_by(observation.c.idempotency_key).having(func.count() > 1))

    def orphans(self) -> Iterator[tuple[str, int, int]]:
        """Table, location id and number of the rows whose location does not exist."""
        for table in metadata.sorted_tables:
            if "location_id" in table.c:
                owner = table.c.location_id
                query = select(owner, func.count()).where(owner.not_in(select(location.c.id))).group_by(owner)
                for row in self._connection.execute(query):
                    yield table.name, row[0], row[1]

    def counters(self) -> Iterator[tuple[str, int, int]]:
        """Name, value and the greatest number in use, of what is numbered across locations."""
        tables: dict[str, Table] = {"anomaly": anomaly, "job": job, "scan": scan}
        for name, table in tables.items():
            value = self._connection.execute(select(counter.c.value).where(counter.c.name == name)).scalar() or 0
            yield name, value, self._connection.execute(select(func.max(table.c.id))).scalar() or 0

    def file_damage(self) -> Iterator[str]:
        """What SQLite says of its own file; nothing on PostgreSQL, whose `pg_amcheck` does that."""
        if self._connection.dialect.name == "sqlite":
            rows = self._connection.execute(text("PRAGMA integrity_check")).scalars()
            yield from (row for row in rows if row != "ok")

    def _rows(self, query: Select[Any]) -> Iterator[Row]:
        with self._connection.execute(query, execution_options={"yield_per": PORTION}) as rows:
            yield from rows

"""Verify: whether everything stored can be read, and fits together. Nothing is written."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

from sqlalchemy.exc import DBAPIError

from tidemap.errors import DatabaseUnusableError
from tidemap.services.checks import LogTotals, check_location, location_of
from tidemap.storage.inspection import Inspection, Snapshot, inspect


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that is wrong; `location` is None where it concerns the database as a whole."""

    location: str | None
    where: str
    what: str

    def __str__(self) -> str:
        location = "" if self.location is None else f"location {self.location!r}, "
        return f"{location}{self.where}: {self.what}"


def verify(
    url: str, report: Callable[[Finding], None], progress: Callable[[int, int], None] = lambda done, total: None
) -> LogTotals:
    """Look at every row of a database, which a server may be using; `report` hears of what is wrong.

    `progress` hears how many locations are done and how many there are.
    Each location is seen as it was at one moment, and its rows are held a few at a time.
    Raises SchemaVersionError, DatabaseUnusableError.
    """
    tally = LogTotals()
    with inspect(url) as inspection:
        for finding in _findings(inspection, tally, progress):
            report(finding)
    return tally


def _findings(inspection: Inspection, tally: LogTotals, progress: Callable[[int, int], None]) -> Iterator[Finding]:
    yield from _guarded(inspection, "database", _whole)
    with inspection.snapshot() as snapshot:
        numbers = snapshot.location_ids()
    for done, number in enumerate(numbers):
        progress(done, len(numbers))
        yield from _guarded(inspection, f"location {number}", partial(_location, number=number, tally=tally))
    progress(len(numbers), len(numbers))


def _guarded(inspection: Inspection, where: str, check: Callable[[Snapshot], Iterator[Finding]]) -> Iterator[Finding]:
    """What a check finds in one snapshot; that the database itself fails there is a finding too."""
    try:
        with inspection.snapshot() as snapshot:
            yield from check(snapshot)
    except DBAPIError as error:
        if error.connection_invalidated:
            raise DatabaseUnusableError(f"The database went away meanwhile: {error.orig}") from error
        yield Finding(None, where, f"the database cannot read it: {error.orig}")


def _whole(snapshot: Snapshot) -> Iterator[Finding]:
    for said in snapshot.file_damage():
        yield Finding(None, "database file", said)
    for table, location_id, number in snapshot.orphans():
        yield Finding(None, f"table {table}", f"{number} rows of location {location_id}, which does not exist")
    for name, value, highest in snapshot.counters():
        if highest > value:
            yield Finding(None, f"counter {name}", f"it stands at {value}, but {highest} is in use")
    for key in snapshot.api_keys():
        if len(key.hash) != 32 or key.role not in ("robot", "operator", "admin"):
            yield Finding(None, f"API key {key.id}", "its hash or its role cannot be")


def _location(snapshot: Snapshot, number: int, tally: LogTotals) -> Iterator[Finding]:
    row = snapshot.location(number)
    if row is None:
        return
    tally.locations += 1
    try:
        location = location_of(row)
    except ValueError as error:
        yield Finding(row.name, "settings", str(error))
        return
    for where, what in check_location(snapshot, location, tally):
        yield Finding(location.name, where, what)

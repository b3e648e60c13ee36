"""The repository of revisions and their spectra."""

from collections.abc import Collection
from contextlib import suppress
from dataclasses import fields

from sqlalchemy import Connection, bindparam, delete, func, insert, select, update

from tidemap.errors import CorruptChunkError
from tidemap.spectral.spectrum import Spectrum
from tidemap.storage.blobs import pack_json, pack_numbers, pack_spectrum, unpack_spectrum
from tidemap.storage.records import PERSISTENCE_VERSION, LocationRecord, RevisionRecord
from tidemap.storage.tables import location as location_table
from tidemap.storage.tables import revision, spectrum

_CHUNK = select(spectrum.c.payload).where(
    spectrum.c.location_id == bindparam("location"),
    spectrum.c.revision == bindparam("number"),
    spectrum.c.chunk == bindparam("part"),
)
"""Built once: loading a large location asks it a thousand times."""


class SpectrumRepository:
    """Spectra by location and revision. A revision is visible once `publish` names it in the location."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def get(self, location_id: int, number: int) -> RevisionRecord | None:
        """A revision, None when there is no such."""
        query = select(revision).where(revision.c.location_id == location_id, revision.c.revision == number)
        row = self._connection.execute(query).mappings().first()
        return None if row is None else RevisionRecord.of(row)

    def current(self, of: Collection[int] | None = None) -> dict[int, RevisionRecord]:
        """The visible revision of every location that has one, by location id; or of those of some ids.

        One that cannot be read is left out, so that it keeps nobody from the others; `get` says what is wrong with it.
        """
        query = select(revision).join(
            location_table,
            (location_table.c.id == revision.c.location_id) & (location_table.c.revision == revision.c.revision),
        )
        if of is not None:
            query = query.where(revision.c.location_id.in_(of))
        found = {}
        for row in self._connection.execute(query).mappings():
            with suppress(CorruptChunkError):
                found[row["location_id"]] = RevisionRecord.of(row)
        return found

    def next_number(self, location_id: int) -> int:
        """A number no stored spectrum of the location has used."""
        used = select(func.max(spectrum.c.revision)).where(spectrum.c.location_id == location_id)
        stored = self._connection.execute(used).scalar() or 0
        shown = select(location_table.c.revision).where(location_table.c.id == location_id)
        return max(int(stored), int(self._connection.execute(shown).scalar() or 0)) + 1

    def put_chunk(self, location_id: int, number: int, chunk: int, value: Spectrum) -> None:
        """Store one chunk of a revision that is not visible yet."""
        row = {"location_id": location_id, "revision": number, "chunk": chunk}
        self._connection.execute(insert(spectrum).values(payload=pack_spectrum(value), **row))

    def publish(self, record: RevisionRecord) -> None:
        """Make a revision the visible one and drop what is stored of earlier ones.

        Where a later one is visible already, it stays so; chunks of later ones, still being stored, stay too.
        """
        mine = location_table.c.id == record.location_id
        earlier = location_table.c.revision < record.revision
        shown = self._connection.execute(update(location_table).where(mine, earlier).values(revision=record.revision))
        if shown.rowcount == 1:
            row = {field.name: getattr(record, field.name) for field in fields(record)}
            row["recipe"] = pack_json(record.recipe.as_dict())
            lasting = record.persistence.as_dict() | {"offset": list(row.pop("offset").items())}
            row["persistence"] = pack_json(lasting, PERSISTENCE_VERSION)
            row["detector"] = pack_json(record.detector.as_dict()) if record.detector else None
            row["selection"] = pack_json(record.selection) if record.selection else None
            row["chunks"] = None if record.chunks is None else pack_numbers(record.chunks)
            self._connection.execute(insert(revision).values(**row))
        visible = select(location_table.c.revision).where(mine).scalar_subquery()
        for table in (spectrum, revision):
            passed = (table.c.location_id == record.location_id) & (table.c.revision < visible)
            self._connection.execute(delete(table).where(passed))

    def chunk(self, location: LocationRecord, number: int, chunk: int) -> Spectrum:
        """One chunk of a revision. Raises CorruptChunkError where it is missing or damaged."""
        payload = self._connection.execute(_CHUNK, {"location": location.id, "number": number, "part": chunk}).scalar()
        what = f"spectrum of location {location.name!r}, chunk {chunk}"
        if payload is None:
            raise CorruptChunkError(what, f"it is missing from revision {number}")
        return unpack_spectrum(payload, what, location.base)

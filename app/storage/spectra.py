"""The repository of revisions and their spectra."""

import json
from dataclasses import fields

from sqlalchemy import Connection, delete, func, insert, select, update

from app.errors import CorruptChunkError
from app.spectral.spectrum import Spectrum
from app.storage.blobs import pack_spectrum, unpack_spectrum
from app.storage.records import LocationRecord, RevisionRecord
from app.storage.tables import location, revision, spectrum


class Spectra:
    """Spectra by location and revision. A revision is visible once `publish` names it in the location."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def get(self, location_id: int, number: int) -> RevisionRecord | None:
        """A revision, None when there is no such."""
        query = select(revision).where(revision.c.location_id == location_id, revision.c.revision == number)
        row = self._connection.execute(query).mappings().first()
        return None if row is None else RevisionRecord.of(row)

    def current(self) -> dict[int, RevisionRecord]:
        """The visible revision of every location that has one, by location id."""
        query = select(revision).join(
            location, (location.c.id == revision.c.location_id) & (location.c.revision == revision.c.revision)
        )
        rows = self._connection.execute(query).mappings()
        return {row["location_id"]: RevisionRecord.of(row) for row in rows}

    def next_number(self, location_id: int) -> int:
        """A number no stored spectrum of the location has used."""
        used = select(func.max(spectrum.c.revision)).where(spectrum.c.location_id == location_id)
        stored = self._connection.execute(used).scalar() or 0
        shown = select(location.c.revision).where(location.c.id == location_id)
        return max(int(stored), int(self._connection.execute(shown).scalar() or 0)) + 1

    def put_chunk(self, location_id: int, number: int, chunk: int, value: Spectrum) -> None:
        """Store one chunk of a revision that is not visible yet."""
        row = {"location_id": location_id, "revision": number, "chunk": chunk}
        self._connection.execute(insert(spectrum).values(payload=pack_spectrum(value), **row))

    def publish(self, record: RevisionRecord) -> None:
        """Make a revision the visible one and drop what is stored of earlier ones.

        Where a later one is visible already, it stays so; chunks of later ones, still being stored, stay too.
        """
        mine = location.c.id == record.location_id
        earlier = location.c.revision < record.revision
        shown = self._connection.execute(update(location).where(mine, earlier).values(revision=record.revision))
        if shown.rowcount == 1:
            row = {field.name: getattr(record, field.name) for field in fields(record)}
            row["recipe"] = record.recipe.to_text()
            row["selection"] = json.dumps(record.selection) if record.selection else None
            self._connection.execute(insert(revision).values(**row))
        visible = select(location.c.revision).where(mine).scalar_subquery()
        for table in (spectrum, revision):
            passed = (table.c.location_id == record.location_id) & (table.c.revision < visible)
            self._connection.execute(delete(table).where(passed))

    def chunk(self, place: LocationRecord, number: int, chunk: int) -> Spectrum:
        """One chunk of a revision. Raises CorruptChunkError where it is missing or damaged."""
        query = select(spectrum.c.payload).where(
            spectrum.c.location_id == place.id, spectrum.c.revision == number, spectrum.c.chunk == chunk
        )
        payload = self._connection.execute(query).scalar()
        what = f"spectrum of location {place.name!r}, chunk {chunk}"
        if payload is None:
            raise CorruptChunkError(what, f"it is missing from revision {number}")
        return unpack_spectrum(payload, what)

"""The repository of history segments: what was compacted, by chunk of cells and stretch of samples."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import groupby
from typing import Any

from sqlalchemy import ColumnElement, Connection, delete, insert, select, update

from tidemap.errors import CorruptChunkError
from tidemap.history.segment import SEGMENT_SAMPLES, Segment, forget, merge, standing
from tidemap.storage.blobs import pack_segment, unpack_segment
from tidemap.storage.records import LocationRecord
from tidemap.storage.tables import history, location

SegmentKey = tuple[int, int]
"""(chunk, segment); chunk -1 - n holds what came in for chunk n while its own segment was damaged."""


class Segments:
    """The compacted history of locations."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def of_chunk(self, place: LocationRecord, chunk: int, first: int, last: int) -> Iterator[tuple[int, Segment]]:
        """The stored segments of a chunk with numbers in [first, last], ascending, with what was put aside for them.

        Each is unpacked when it is asked for: with ranks it takes nine times as much as its planes. Raises
        CorruptChunkError where one is damaged.
        """
        rows = self._stored(place, (chunk, -1 - chunk), first, last)
        for number, found in groupby(rows, key=lambda row: row.segment):
            segment, *asides = [_unpack(place, row) for row in found]
            for aside in asides:
                segment = merge(segment, standing(aside, place.base), place.base)
            yield number, segment

    def put_aside(self, place: LocationRecord, chunk: int, number: int) -> Segment | None:
        """What came in for a segment while it was damaged. Raises CorruptChunkError where that is damaged too."""
        return next((_unpack(place, row) for row in self._stored(place, (-1 - chunk,), number, number)), None)

    def _stored(self, place: LocationRecord, chunks: tuple[int, ...], first: int, last: int) -> Sequence[Any]:
        """Segments, packed, ascending; what was put aside for one comes behind it."""
        query = (
            select(history.c.chunk, history.c.segment, history.c.payload)
            .where(history.c.location_id == place.id, history.c.chunk.in_(chunks))
            .where(history.c.segment >= first, history.c.segment <= last)
            .order_by(history.c.segment, history.c.chunk.desc())
        )
        # All at once: a statement left open would show every later reader this moment's rows.
        return self._connection.execute(query).all()

    def put(self, place: LocationRecord, segments: Mapping[SegmentKey, bytes]) -> None:
        """Store segments, packed, in place of those with their keys and of what was put aside for them."""
        for (chunk, number), payload in segments.items():
            self._put(place.id, chunk, number, payload)
        for chunk, number in self._asides(place):
            if (-1 - chunk, number) in segments:
                self._connection.execute(delete(history).where(*_at(place.id, chunk, number)))

    def forget(self, place: LocationRecord, before: int) -> None:
        """Drop the compacted history before a sample, all of it and nothing else.

        Of a damaged segment that lies on both sides of it nothing can be dropped yet.
        """
        border = before // SEGMENT_SAMPLES
        mine = history.c.location_id == place.id
        self._connection.execute(delete(history).where(mine, history.c.segment < border))
        chunks = select(history.c.chunk).where(mine, history.c.segment == border)
        for chunk in self._connection.execute(chunks).scalars().all():
            with suppress(CorruptChunkError):
                segment = _unpack(place, self._stored(place, (chunk,), border, border)[0])
                self._put(place.id, chunk, border, pack_segment(forget(segment, before, place.base)))
        first = float(place.base.time(before))
        self._connection.execute(
            update(location).where(location.c.id == place.id, location.c.first_time < first).values(first_time=first)
        )

    def _asides(self, place: LocationRecord) -> list[SegmentKey]:
        """Where something is put aside: nowhere, unless something is damaged."""
        query = select(history.c.chunk, history.c.segment).where(history.c.location_id == place.id, history.c.chunk < 0)
        return [(row.chunk, row.segment) for row in self._connection.execute(query)]

    def _put(self, location_id: int, chunk: int, number: int, payload: bytes) -> None:
        stored = self._connection.execute(
            update(history).where(*_at(location_id, chunk, number)).values(payload=payload)
        )
        if stored.rowcount == 0:
            row = {"location_id": location_id, "chunk": chunk, "segment": number, "payload": payload}
            self._connection.execute(insert(history).values(**row))


def _unpack(place: LocationRecord, row: Any) -> Segment:
    chunk, aside = (row.chunk, "") if row.chunk >= 0 else (-1 - row.chunk, " put aside")
    what = f"history{aside} of location {place.name!r}, chunk {chunk}, segment {row.segment}"
    return unpack_segment(row.payload, row.segment, what)


def _at(location_id: int, chunk: int, number: int) -> tuple[ColumnElement[bool], ...]:
    """The row of one segment."""
    return history.c.location_id == location_id, history.c.chunk == chunk, history.c.segment == number

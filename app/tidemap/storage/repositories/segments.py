"""The repository of history segments: what was compacted, by chunk of cells and stretch of samples."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import groupby
from typing import Any

from sqlalchemy import ColumnElement, Connection, delete, insert, select, update

from tidemap.errors import CorruptChunkError
from tidemap.history.erasing import forget
from tidemap.history.segment import SEGMENT_SAMPLES, Segment, join
from tidemap.storage.blobs import pack_segment, unpack_segment
from tidemap.storage.records import LocationRecord
from tidemap.storage.tables import history
from tidemap.storage.tables import location as location_table

SegmentKey = tuple[int, int]
"""(chunk, segment); chunk -1 - n holds what came in for chunk n while its own segment was damaged."""


class SegmentRepository:
    """The compacted history of locations."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def of_chunk(self, location: LocationRecord, chunk: int, first: int, last: int) -> Iterator[tuple[int, Segment]]:
        """The stored segments of a chunk with numbers in [first, last], ascending, with what was put aside for them.

        Each is unpacked when it is asked for: with ranks it takes nine times as much as its planes. Raises
        CorruptChunkError where one is damaged.
        """
        rows = self._stored(location, (chunk, -1 - chunk), first, last)
        for number, found in groupby(rows, key=lambda row: row.segment):
            segment, *asides = [_unpack(location, row) for row in found]
            for aside in asides:
                segment = join(segment, aside, location.base, location.combine)
            yield number, segment

    def numbers(self, location_id: int) -> list[int]:
        """The numbers of the segments that some chunk has, ascending."""
        query = select(history.c.segment).where(history.c.location_id == location_id).distinct()
        return sorted(self._connection.execute(query).scalars())

    def put_aside(self, location: LocationRecord, chunk: int, number: int) -> Segment | None:
        """What came in for a segment while it was damaged. Raises CorruptChunkError where that is damaged too."""
        return next((_unpack(location, row) for row in self._stored(location, (-1 - chunk,), number, number)), None)

    def _stored(self, location: LocationRecord, chunks: tuple[int, ...], first: int, last: int) -> Sequence[Any]:
        """Segments, packed, ascending; what was put aside for one comes behind it."""
        query = (
            select(history.c.chunk, history.c.segment, history.c.payload)
            .where(history.c.location_id == location.id, history.c.chunk.in_(chunks))
            .where(history.c.segment >= first, history.c.segment <= last)
            .order_by(history.c.segment, history.c.chunk.desc())
        )
        # All at once: a statement left open would show every later reader this moment's rows.
        return self._connection.execute(query).all()

    def put(self, location: LocationRecord, segments: Mapping[SegmentKey, bytes]) -> None:
        """Store segments, packed, in place of those with their keys and of what was put aside for them."""
        for (chunk, number), payload in segments.items():
            self._put(location.id, chunk, number, payload)
        for chunk, number in self._asides(location):
            if (-1 - chunk, number) in segments:
                self._connection.execute(delete(history).where(*_at(location.id, chunk, number)))

    def forget(self, location: LocationRecord, before: int) -> None:
        """Drop the compacted history before a sample, all of it and nothing else.

        Of a damaged segment that lies on both sides of it nothing can be dropped yet.
        """
        border = before // SEGMENT_SAMPLES
        mine = history.c.location_id == location.id
        self._connection.execute(delete(history).where(mine, history.c.segment < border))
        chunks = select(history.c.chunk).where(mine, history.c.segment == border)
        for chunk in self._connection.execute(chunks).scalars().all():
            with suppress(CorruptChunkError):
                segment = _unpack(location, self._stored(location, (chunk,), border, border)[0])
                self._put(location.id, chunk, border, pack_segment(forget(segment, before, location.base)))
        first = float(location.base.time(before))
        self._connection.execute(
            update(location_table)
            .where(location_table.c.id == location.id, location_table.c.first_time < first)
            .values(first_time=first)
        )

    def _asides(self, location: LocationRecord) -> list[SegmentKey]:
        """Where something is put aside: nowhere, unless something is damaged."""
        query = select(history.c.chunk, history.c.segment).where(
            history.c.location_id == location.id, history.c.chunk < 0
        )
        return [(row.chunk, row.segment) for row in self._connection.execute(query)]

    def _put(self, location_id: int, chunk: int, number: int, payload: bytes) -> None:
        stored = self._connection.execute(
            update(history).where(*_at(location_id, chunk, number)).values(payload=payload)
        )
        if stored.rowcount == 0:
            row = {"location_id": location_id, "chunk": chunk, "segment": number, "payload": payload}
            self._connection.execute(insert(history).values(**row))


def _unpack(location: LocationRecord, row: Any) -> Segment:
    chunk, aside = (row.chunk, "") if row.chunk >= 0 else (-1 - row.chunk, " put aside")
    what = f"history{aside} of location {location.name!r}, chunk {chunk}, segment {row.segment}"
    return unpack_segment(row.payload, row.segment, what)


def _at(location_id: int, chunk: int, number: int) -> tuple[ColumnElement[bool], ...]:
    """The row of one segment."""
    return history.c.location_id == location_id, history.c.chunk == chunk, history.c.segment == number

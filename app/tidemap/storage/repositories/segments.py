"""The repository of history segments: what was compacted, by chunk of cells and stretch of samples."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import ColumnElement, Connection, bindparam, delete, insert, select, update

from tidemap.errors import CorruptChunkError
from tidemap.history.erasing import forget
from tidemap.history.segment import SEGMENT_SAMPLES, Segment, join
from tidemap.storage.blobs import observed_counts, pack_segment, unpack_segment
from tidemap.storage.records import LocationRecord
from tidemap.storage.tables import history

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
        rows = self._stored(location, chunk, first, last, aside=-1 - chunk)
        for number, found in groupby(rows, key=lambda row: row.segment):
            segment, *asides = [_unpack(location, row) for row in found]
            for aside in asides:
                segment = join(segment, aside, location.base, location.combine)
            yield number, segment

    def chunks(self, location_id: int) -> NDArray[np.int64]:
        """The chunks that something is stored for, ascending."""
        query = select(history.c.chunk).where(history.c.location_id == location_id).distinct()
        found = np.array(self._connection.execute(query).scalars().all(), np.int64)
        return np.unique(np.maximum(found, -1 - found))

    def numbers(self, location_id: int) -> list[int]:
        """The numbers of the segments that some chunk has, ascending."""
        query = select(history.c.segment).where(history.c.location_id == location_id).distinct()
        return sorted(self._connection.execute(query).scalars())

    def keys(self, location_id: int, first: int, last: int) -> list[SegmentKey]:
        """Chunk and number of the segments with numbers in [first, last], those put aside among their chunk's."""
        query = select(history.c.chunk, history.c.segment).where(history.c.location_id == location_id)
        rows = self._connection.execute(query.where(history.c.segment >= first, history.c.segment <= last))
        return sorted({(max(row.chunk, -1 - row.chunk), row.segment) for row in rows})

    def times(self, location: LocationRecord) -> tuple[float, float] | None:
        """The first and the last time of what was measured and can be read; None without any."""
        numbers = self.numbers(location.id)
        first = next(filter(len, (self._times_at(location, number) for number in numbers)), None)
        last = next(filter(len, (self._times_at(location, number) for number in reversed(numbers))), None)
        return None if first is None or last is None else (float(first.min()), float(last.max()))

    def _times_at(self, location: LocationRecord, number: int) -> NDArray[np.float64]:
        """Times of every chunk's segment of this number that can be read, the first and the last among them."""
        ends = [np.empty(0)]
        query = select(history).where(history.c.location_id == location.id, history.c.segment == number)
        for row in self._connection.execute(query).all():
            with suppress(CorruptChunkError):
                segment = _unpack(location, row)
                ends.append(segment.time[[0, -1]] if len(segment.time) else segment.time)
                ends.append(np.empty(0) if segment.ends is None else segment.ends.time)
        return np.concatenate(ends)

    def counts(self, location: LocationRecord, number: int, stride: int) -> NDArray[np.int64]:
        """(SEGMENT_SAMPLES,) how many cells were observed in each sample of a segment, of every `stride`th chunk.

        What cannot be read, and what was put aside for it, is not counted.
        """
        query = (
            select(history.c.chunk, history.c.payload)
            .where(history.c.location_id == location.id, history.c.segment == number)
            .where(history.c.chunk >= 0, history.c.chunk % stride == 0)
        )
        total = np.zeros(SEGMENT_SAMPLES, np.int64)
        for row in self._connection.execute(query).all():
            with suppress(CorruptChunkError):
                total += observed_counts(row.payload, f"chunk {row.chunk} of location {location.name!r}")
        return total

    def put_aside(self, location: LocationRecord, chunk: int, number: int) -> Segment | None:
        """What came in for a segment while it was damaged. Raises CorruptChunkError where that is damaged too."""
        return next((_unpack(location, row) for row in self._stored(location, -1 - chunk, number, number)), None)

    def _stored(
        self, location: LocationRecord, chunk: int, first: int, last: int, aside: int | None = None
    ) -> Sequence[Any]:
        """Segments, packed, ascending; what was put aside for one comes behind it."""
        bounds = {"location": location.id, "chunk": chunk, "aside": chunk if aside is None else aside}
        # All at once: a statement left open would show every later reader this moment's rows.
        return self._connection.execute(_SEGMENTS, bounds | {"first": first, "last": last}).all()

    def put(self, location: LocationRecord, segments: Mapping[SegmentKey, bytes]) -> None:
        """Store segments, packed, in place of those with their keys and of what was put aside for them.

        Of one that is empty, b"", nothing is kept.
        """
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
                segment = _unpack(location, self._stored(location, chunk, border, border)[0])
                left = forget(segment, before, location.base)
                self._put(location.id, chunk, border, b"" if left.is_empty else pack_segment(left))

    def _asides(self, location: LocationRecord) -> list[SegmentKey]:
        """Where something is put aside: nowhere, unless something is damaged."""
        query = select(history.c.chunk, history.c.segment).where(
            history.c.location_id == location.id, history.c.chunk < 0
        )
        return [(row.chunk, row.segment) for row in self._connection.execute(query)]

    def _put(self, location_id: int, chunk: int, number: int, payload: bytes) -> None:
        if not payload:
            self._connection.execute(delete(history).where(*_at(location_id, chunk, number)))
            return
        stored = self._connection.execute(
            update(history).where(*_at(location_id, chunk, number)).values(payload=payload)
        )
        if stored.rowcount == 0:
            row = {"location_id": location_id, "chunk": chunk, "segment": number, "payload": payload}
            self._connection.execute(insert(history).values(**row))


# Built once: a question about a large map asks it a thousand times.
_SEGMENTS = (
    select(history.c.chunk, history.c.segment, history.c.payload)
    .where(history.c.location_id == bindparam("location"))
    .where(history.c.chunk.in_((bindparam("chunk"), bindparam("aside"))))
    .where(history.c.segment >= bindparam("first"), history.c.segment <= bindparam("last"))
    .order_by(history.c.segment, history.c.chunk.desc())
)


def _unpack(location: LocationRecord, row: Any) -> Segment:
    chunk, aside = (row.chunk, "") if row.chunk >= 0 else (-1 - row.chunk, " put aside")
    what = f"history{aside} of location {location.name!r}, chunk {chunk}, segment {row.segment}"
    return unpack_segment(row.payload, row.segment, what)


def _at(location_id: int, chunk: int, number: int) -> tuple[ColumnElement[bool], ...]:
    """The row of one segment."""
    return history.c.location_id == location_id, history.c.chunk == chunk, history.c.segment == number

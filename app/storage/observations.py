"""The repository of the observation log and of the compacted history."""

from collections.abc import Mapping

from sqlalchemy import (
    BindParameter,
    Case,
    Column,
    ColumnElement,
    Connection,
    Float,
    bindparam,
    case,
    delete,
    func,
    insert,
    or_,
    select,
    update,
)

from app.errors import IdempotencyConflictError, LocationNotFoundError
from app.spectral.measurements import Measurements
from app.spectral.segment import SEGMENT_SAMPLES, Segment, forget
from app.storage.blobs import pack_segment, unpack_measurements, unpack_segment
from app.storage.records import LocationRecord, ObservationRecord
from app.storage.tables import history, location, observation

SegmentKey = tuple[int, int]
"""(chunk, segment)."""


class Observations:
    """The log and the history of locations."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def find_duplicate(self, place: LocationRecord, key: str, body_hash: bytes) -> bool:
        """Whether this key is stored with this body. Raises IdempotencyConflictError with another body."""
        row = self._connection.execute(_BY_KEY, {"place": place.id, "key": key}).first()
        if row is None:
            return False
        if row.body_hash != body_hash:
            raise IdempotencyConflictError(key)
        return True

    def append(self, place: LocationRecord, record: ObservationRecord) -> int:
        """Append to the log; the new observation's number. LocationNotFoundError when it was deleted meanwhile."""
        more = {"place": place.id, "more": record.measurements, "first": record.first_time, "last": record.last_time}
        number = self._connection.execute(_NUMBER, more).scalar()
        if number is None:
            raise LocationNotFoundError(place.name)
        self._connection.execute(_APPEND, {"location_id": place.id, "id": number, **vars(record)})
        return int(number)

    def tail(self, place: LocationRecord, most: int | None = None) -> list[tuple[int, Measurements]]:
        """The observations that are not compacted yet, with their numbers.

        With `most`, the earliest of them that hold no more measurements together, but at least one.
        """
        query = (
            select(observation.c.id, observation.c.measurements, observation.c.payload)
            .where(observation.c.location_id == place.id, observation.c.id > place.compacted_seq)
            .where(observation.c.id <= place.observation_seq)
            .order_by(observation.c.id)
        )
        parts: list[tuple[int, Measurements]] = []
        total = 0
        with self._connection.execute(query, execution_options={"yield_per": 64}) as rows:
            for row in rows:
                total += row.measurements
                if parts and most is not None and total > most:
                    break
                what = f"observation {row.id} of location {place.name!r}"
                parts.append((row.id, unpack_measurements(row.payload, what)))
        return parts

    def waiting(self) -> dict[int, int]:
        """How many measurements are not compacted yet, by location id; those without any are left out."""
        query = (
            select(observation.c.location_id, func.sum(observation.c.measurements))
            .join(location, location.c.id == observation.c.location_id)
            .where(observation.c.id > location.c.compacted_seq)
            .group_by(observation.c.location_id)
        )
        return {row[0]: int(row[1]) for row in self._connection.execute(query)}

    def segments(self, place: LocationRecord, chunk: int, first: int, last: int) -> dict[int, Segment]:
        """The stored segments of a chunk with numbers in [first, last]."""
        query = (
            select(history.c.segment, history.c.payload)
            .where(history.c.location_id == place.id, history.c.chunk == chunk)
            .where(history.c.segment >= first, history.c.segment <= last)
        )
        what = f"history of location {place.name!r}, chunk {chunk}"
        return {
            row.segment: unpack_segment(row.payload, row.segment, f"{what}, segment {row.segment}")
            for row in self._connection.execute(query)
        }

    def compact(self, place: LocationRecord, through: int, segments: Mapping[SegmentKey, bytes]) -> bool:
        """Put merged segments, packed, in place of the log up to number `through`.

        False, and nothing done, when somebody else has compacted since `place` was read.
        """
        claimed = self._connection.execute(
            update(location)
            .where(location.c.id == place.id, location.c.compacted_seq == place.compacted_seq)
            .values(compacted_seq=through)
        )
        if claimed.rowcount != 1:
            return False
        for (chunk, number), payload in segments.items():
            self._put(place.id, chunk, number, payload)
        self._connection.execute(
            update(observation)
            .where(observation.c.location_id == place.id, observation.c.id > place.compacted_seq)
            .where(observation.c.id <= through)
            .values(payload=None)
        )
        return True

    def forget(self, place: LocationRecord, before: int) -> None:
        """Drop the compacted history before a sample, all of it and nothing else."""
        border = before // SEGMENT_SAMPLES
        mine = history.c.location_id == place.id
        self._connection.execute(delete(history).where(mine, history.c.segment < border))
        chunks = select(history.c.chunk).where(mine, history.c.segment == border)
        for chunk in self._connection.execute(chunks).scalars().all():
            segment = self.segments(place, chunk, border, border)[border]
            self._put(place.id, chunk, border, pack_segment(forget(segment, before, place.base)))
        first = float(place.base.time(before))
        self._connection.execute(
            update(location).where(location.c.id == place.id, location.c.first_time < first).values(first_time=first)
        )

    def _put(self, location_id: int, chunk: int, number: int, payload: bytes) -> None:
        key = {"location_id": location_id, "chunk": chunk, "segment": number}
        stored = self._connection.execute(
            update(history).where(*(history.c[name] == value for name, value in key.items())).values(payload=payload)
        )
        if stored.rowcount == 0:
            self._connection.execute(insert(history).values(payload=payload, **key))


def _unless(column: Column[float], passed: ColumnElement[bool], value: BindParameter[float]) -> Case[float]:
    """The column's value, or `value` where it is empty or passed."""
    return case((or_(column.is_(None), passed), value), else_=column)


# Statements of every post, built once: building one takes longer than running it.
_FIRST, _LAST = bindparam("first", type_=Float(53)), bindparam("last", type_=Float(53))
_BY_KEY = select(observation.c.body_hash).where(
    observation.c.location_id == bindparam("place"), observation.c.idempotency_key == bindparam("key")
)
_NUMBER = (
    update(location)
    .where(location.c.id == bindparam("place"))
    .values(
        observation_seq=location.c.observation_seq + 1,
        measurements=location.c.measurements + bindparam("more"),
        first_time=_unless(location.c.first_time, location.c.first_time > _FIRST, _FIRST),
        last_time=_unless(location.c.last_time, location.c.last_time < _LAST, _LAST),
    )
    .returning(location.c.observation_seq)
)
_APPEND = insert(observation)

"""The repository of the observation log."""

from collections.abc import Callable, Collection, Generator, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from itertools import takewhile

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

from tidemap.errors import CorruptChunkError
from tidemap.history.measurements import Measurements
from tidemap.storage.blobs import unpack_measurements
from tidemap.storage.changes import UNCOUNTED
from tidemap.storage.records import LocationRecord, ObservationRecord
from tidemap.storage.tables import location as location_table
from tidemap.storage.tables import observation

MAX_FREED_PAGES = 4096
"""Pages of the file that are given back at once."""


@dataclass(frozen=True, slots=True, eq=False)
class Packed:
    """An observation that is not compacted yet, as it is stored; `what` names it."""

    number: int
    measurements: int
    source: str | None
    payload: bytes
    what: str

    def unpack(self) -> Measurements:
        """Raises CorruptChunkError."""
        return unpack_measurements(self.payload, self.what)


@dataclass(frozen=True, slots=True, eq=False)
class Tail:
    """Observations that are not compacted yet, with their numbers; those that cannot be read are in `damage`."""

    parts: list[tuple[int, Measurements]]
    damage: dict[int, CorruptChunkError]


class ObservationRepository:
    """The log of locations: what was posted, and of it the tail that is not compacted yet."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def digests(self, location_id: int, keys: Sequence[str]) -> dict[str, bytes]:
        """The digest of the body that each of the idempotency keys was used for; unused ones are left out."""
        rows = self._connection.execute(_BY_KEY, {"location": location_id, "keys": keys}) if keys else ()
        return {row.idempotency_key: row.body_hash for row in rows}

    def append(self, location_id: int, records: Sequence[ObservationRecord]) -> int | None:
        """Append to the log; the number of the first, which the others follow. None where the location is gone."""
        more = {
            "location": location_id,
            "count": len(records),
            "more": sum(record.measurements for record in records),
            "first": min(record.first_time for record in records),
            "last": max(record.last_time for record in records),
        }
        number = self._connection.execute(_NUMBER, more).scalar()
        if number is None:
            return None
        first = int(number) - len(records) + 1
        rows = [{"location_id": location_id, "id": first + i, **vars(record)} for i, record in enumerate(records)]
        self._connection.execute(_APPEND, rows)
        return first

    def packed(self, location: LocationRecord, most: int) -> list[Packed]:
        """The earliest observations that are not compacted yet: those with at most so many measurements, or one."""
        rows: list[Packed] = []
        total = 0
        with closing(self._pending(location)) as pending:
            for row in pending:
                total += row.measurements
                if rows and total > most:
                    break
                rows.append(row)
        return rows

    def tail(
        self, location: LocationRecord, choose: Callable[[Measurements], Measurements] = lambda every: every
    ) -> Tail:
        """The observations that are not compacted yet; of each what `choose` takes."""
        tail = Tail([], {})
        with closing(self._pending(location)) as pending:
            for row in pending:
                try:
                    tail.parts.append((row.number, choose(row.unpack())))
                except CorruptChunkError as error:
                    tail.damage[row.number] = error.with_traceback(None)
        return tail

    def _pending(self, location: LocationRecord) -> Generator[Packed]:
        query = (
            select(observation.c.id, observation.c.measurements, observation.c.source, observation.c.payload)
            .where(observation.c.location_id == location.id, observation.c.id > location.compacted_seq)
            .where(observation.c.id <= location.observation_seq)
            .order_by(observation.c.id)
        )
        with self._connection.execute(query, execution_options={"yield_per": 64}) as rows:
            for row in rows:
                yield Packed(*row, f"observation {row.id} of location {location.name!r}")

    def pending(self, location: LocationRecord) -> int:
        """How many measurements of a location are not compacted yet."""
        query = (
            select(func.sum(observation.c.measurements))
            .where(observation.c.location_id == location.id, observation.c.id > location.compacted_seq)
            .where(observation.c.id <= location.observation_seq)
        )
        return int(self._connection.execute(query).scalar() or 0)

    def pending_times(self, location: LocationRecord) -> list[tuple[float, float]]:
        """The first and the last time of every observation that is not compacted yet."""
        query = (
            select(observation.c.first_time, observation.c.last_time)
            .where(observation.c.location_id == location.id, observation.c.id > location.compacted_seq)
            .where(observation.c.id <= location.observation_seq)
        )
        return [(row.first_time, row.last_time) for row in self._connection.execute(query)]

    def pending_between(self, location: LocationRecord, start: float, stop: float) -> Iterator[Measurements]:
        """The observations that are not compacted yet and have measurements in [start, stop), whole; readable ones.

        One after the other, so that few are in memory: to be read to the end before the next statement.
        """
        query = (
            select(observation.c.id, observation.c.payload)
            .where(observation.c.location_id == location.id, observation.c.payload.is_not(None))
            .where(observation.c.id > location.compacted_seq)
            .where(observation.c.first_time < stop, observation.c.last_time >= start)
        )
        with self._connection.execute(query, execution_options={"yield_per": 64}) as rows:
            for row in rows:
                with suppress(CorruptChunkError):
                    yield unpack_measurements(row.payload, f"observation {row.id} of location {location.name!r}")

    def any_since(self, location: LocationRecord, before: float) -> bool:
        """Whether something was posted since a location was read that has measurements before a time."""
        query = (
            select(observation.c.id)
            .where(observation.c.location_id == location.id, observation.c.id > location.observation_seq)
            .where(observation.c.first_time < before)
            .limit(1)
        )
        return self._connection.execute(query).first() is not None

    def recount(self, location: LocationRecord, compacted: tuple[float, float] | None, deleted: int = 0) -> None:
        """Put right what a location counts: the first and last time of what is `compacted` and pending, and what is
        `deleted`. Call it in the transaction that took something away, so that nobody posts meanwhile."""
        mine = location_table.c.id == location.id
        counted = location_table.c.deleted + deleted
        self._connection.execute(update(location_table).where(mine).values(deleted=counted))
        now = self._connection.execute(select(location_table).where(mine)).mappings().one()
        ends = [*([compacted] if compacted else []), *self.pending_times(LocationRecord.of(now))]
        first, last = min((first for first, _ in ends), default=None), max((last for _, last in ends), default=None)
        values = {"first_time": first, "last_time": last}
        left = {} if ends else {"deleted": location_table.c.measurements}
        self._connection.execute(update(location_table).where(mine).values(**values, **left))

    def waiting(self) -> dict[int, int]:
        """How many measurements are not compacted yet, by location id; those without any are left out."""
        query = (
            select(observation.c.location_id, func.sum(observation.c.measurements))
            .join(location_table, location_table.c.id == observation.c.location_id)
            .where(observation.c.id > location_table.c.compacted_seq)
            .group_by(observation.c.location_id)
        )
        return {row[0]: int(row[1]) for row in self._connection.execute(query)}

    def settle(self, location: LocationRecord, through: int, damaged: Collection[int] = ()) -> bool:
        """Have the log compacted up to number `through`; damaged observations stay in it.

        False, and nothing done, when somebody else has compacted or deleted since `location` was read.
        """
        claimed = self._connection.execute(
            update(location_table)
            .where(location_table.c.id == location.id, location_table.c.compacted_seq == location.compacted_seq)
            .where(location_table.c.deleted == location.deleted)
            .values(compacted_seq=through)
            .execution_options(**UNCOUNTED)
        )
        if claimed.rowcount != 1:
            return False
        self._empty(location, through, damaged)
        return True

    def _empty(self, location: LocationRecord, through: int, damaged: Collection[int]) -> None:
        """Take the payload out of the compacted part of the log.

        The rows are written anew: SQLite would leave every one that shrank alone on the page it filled before.
        """
        part = (observation.c.location_id == location.id) & (observation.c.id > location.compacted_seq)
        part &= (observation.c.id <= through) & observation.c.id.not_in(damaged)
        kept = [column for column in observation.c if column is not observation.c.payload]
        rows = self._connection.execute(select(*kept).where(part)).mappings().all()
        self._connection.execute(delete(observation).where(part))
        if rows:
            self._connection.execute(insert(observation), [dict(row) for row in rows])

    def shrink_file(self) -> None:
        """Shorten the file, by 4 MB at most, where more than an eighth of it is free; PostgreSQL does it by itself."""
        if self._connection.dialect.name != "sqlite":
            return
        free, whole = (self._connection.exec_driver_sql(f"PRAGMA {name}").scalar() or 0 for name in _PAGES)
        for _ in range(min(free, MAX_FREED_PAGES) if free > whole // 8 else 0):
            # Python's driver stops after the first page of many.
            self._connection.exec_driver_sql("PRAGMA incremental_vacuum(1)")

    def prunable(self, location_id: int, before: float, most: int) -> int | None:
        """The last of the earliest observations that are compacted and were received before a time; None without any.

        Of `most` at a time, so that what is left of the log has no gaps.
        """
        earliest = (
            select(observation.c.id, observation.c.received_at, observation.c.payload.is_(None).label("compacted"))
            .where(observation.c.location_id == location_id)
            .order_by(observation.c.id)
            .limit(most)
        )
        rows = self._connection.execute(earliest).all()
        old = takewhile(lambda row: row.compacted and row.received_at < before, rows)
        return max((row.id for row in old), default=None)

    def prune(self, location_id: int, through: int) -> int:
        """Drop the log up to an observation that is `prunable`, with the idempotency keys in it; how many rows."""
        mine = (observation.c.location_id == location_id) & (observation.c.id <= through)
        return self._connection.execute(delete(observation).where(mine)).rowcount


def _unless(column: Column[float], passed: ColumnElement[bool], value: BindParameter[float]) -> Case[float]:
    """The column's value, or `value` where it is empty or passed."""
    return case((or_(column.is_(None), passed), value), else_=column)


# Statements of every post, built once: building one takes longer than running it.
_FIRST, _LAST = bindparam("first", type_=Float(53)), bindparam("last", type_=Float(53))
_BY_KEY = select(observation.c.idempotency_key, observation.c.body_hash).where(
    observation.c.location_id == bindparam("location"),
    observation.c.idempotency_key.in_(bindparam("keys", expanding=True)),
)
# What a location without a model holds is never judged, so nothing is to be judged again.
_HELD = (location_table.c.missing == "hold") & (location_table.c.revision > 0)
_NUMBER = (
    update(location_table)
    .where(location_table.c.id == bindparam("location"))
    .values(
        observation_seq=location_table.c.observation_seq + bindparam("count"),
        measurements=location_table.c.measurements + bindparam("more"),
        first_time=_unless(location_table.c.first_time, location_table.c.first_time > _FIRST, _FIRST),
        last_time=_unless(location_table.c.last_time, location_table.c.last_time < _LAST, _LAST),
        judged_to=case((_HELD, _unless(location_table.c.judged_to, location_table.c.judged_to > _FIRST, _FIRST))),
    )
    .returning(location_table.c.observation_seq)
    .execution_options(**UNCOUNTED)
)
_APPEND = insert(observation)
_PAGES = ("freelist_count", "page_count")

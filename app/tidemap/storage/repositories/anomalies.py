"""The repository of anomaly events."""

import builtins
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from sqlalchemy import Connection, RowMapping, Select, bindparam, delete, func, insert, or_, select, update

from tidemap.errors import AnomalyNotFoundError, CorruptChunkError
from tidemap.scope import EVERYWHERE, Scope
from tidemap.storage.blobs import pack_event, unpack_event
from tidemap.storage.counters import take
from tidemap.storage.records import AnomalyRecord
from tidemap.storage.scoping import inside
from tidemap.storage.tables import anomaly, location

_COLUMNS = tuple(field.name for field in fields(AnomalyRecord) if field.name not in ("seen", "damage"))
_GROWS = ("start", "stop", "observed", "probability", "surprise", "confidence", "rule", "revision", "marks")
_KEPT = ("acknowledged_by", "acknowledged_at", "note", "ended", "change", "muted", "snoozed_by", "snoozed_until")
DELETED_AT_ONCE = 400
SILENCE = "silence"
"""The rule of events without cells: a location that usually speaks was silent."""


@dataclass(frozen=True)
class AnomalyFilter:
    """Which events; None leaves a condition out. Times overlap [start, stop), `search` is in the location's name."""

    location_id: int | None = None
    after: int | None = None
    limit: int | None = None
    start: float | None = None
    stop: float | None = None
    min_surprise: float | None = None
    acknowledged: bool | None = None
    scope: Scope = EVERYWHERE
    search: str = ""
    muted: bool | None = None


class AnomalyRepository:
    """Events in the order in which they were first committed, which is that of their ids."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def append(self, records: Sequence[AnomalyRecord]) -> list[AnomalyRecord]:
        """Store new events; returns them with their ids."""
        if not records:
            return []
        first = take(self._connection, "anomaly", len(records))
        numbered = [replace(record, id=first + i, change=first + i) for i, record in enumerate(records)]
        self._connection.execute(insert(anomaly), [_row(record) for record in numbered])
        return numbered

    def list(self, wanted: AnomalyFilter) -> list[AnomalyRecord]:
        """Oldest first."""
        query = _query(wanted).order_by(anomaly.c.id).limit(wanted.limit)
        return [_record(row) for row in self._connection.execute(query).mappings()]

    def newest(self, wanted: AnomalyFilter, before: int | None) -> Sequence[AnomalyRecord]:
        """Newest first, of those with a lower id than `before`."""
        query = _query(wanted).order_by(anomaly.c.id.desc()).limit(wanted.limit)
        if before is not None:
            query = query.where(anomaly.c.id < before)
        return [_record(row) for row in self._connection.execute(query).mappings()]

    def changes_after(self, after: int, limit: int, scope: Scope) -> Sequence[tuple[int, int]]:
        """Numbers of the latest changes of events after one, ascending, and the events' ids; of locations in scope.

        Without what nobody is to hear of.
        """
        query = _audible(_query(AnomalyFilter(scope=scope)).where(anomaly.c.change > after))
        rows = self._connection.execute(
            query.with_only_columns(anomaly.c.change, anomaly.c.id).order_by(anomaly.c.change).limit(limit)
        )
        return [(row.change, row.id) for row in rows]

    def changed(
        self, after: int, limit: int, location_id: int | None, scope: Scope
    ) -> Sequence[tuple[int, AnomalyRecord]]:
        """Events by the numbers after one at which they began or changed last, in order of these."""
        query = _audible(_query(AnomalyFilter(location_id, scope=scope)))
        found: dict[int, RowMapping] = {}
        for number in (anomaly.c.id, anomaly.c.change):
            rows = self._connection.execute(query.where(number > after).order_by(number).limit(limit)).mappings()
            found |= {row[number.name]: row for row in rows}
        return [(number, _record(found[number])) for number in sorted(found)[:limit]]

    def change_of(self, anomaly_id: int) -> int | None:
        """The number of the latest change of an event; None where it is gone or a part of another, or inaudible."""
        query = _audible(_query(AnomalyFilter()).where(anomaly.c.id == anomaly_id))
        found = self._connection.execute(query.with_only_columns(anomaly.c.change)).scalar()
        return None if found is None else int(found)

    def latest(self) -> int:
        """The number of the latest change, 0 when there is none."""
        return self._connection.execute(select(func.max(anomaly.c.change))).scalar() or 0

    def due_to_end(self, location_id: int, before: float) -> Sequence[AnomalyRecord]:
        """The events of a location that have not ended and stopped before a time, but silences."""
        mine = (anomaly.c.location_id == location_id) & anomaly.c.part_of.is_(None) & (anomaly.c.rule != SILENCE)
        query = select(anomaly).where(mine, anomaly.c.ended.is_(False), anomaly.c.stop < before)
        return [_record(row) for row in self._connection.execute(query.order_by(anomaly.c.id)).mappings()]

    def lasting(self) -> dict[int, float]:
        """By id of location when the first of its events stopped that have not ended, silences left out."""
        mine = anomaly.c.ended.is_(False) & anomaly.c.part_of.is_(None) & (anomaly.c.rule != SILENCE)
        query = select(anomaly.c.location_id, func.min(anomaly.c.stop)).where(mine).group_by(anomaly.c.location_id)
        return {row[0]: row[1] for row in self._connection.execute(query)}

    def awake(self, now: float) -> Sequence[AnomalyRecord]:
        """The events whose snooze is over."""
        query = select(anomaly).where(anomaly.c.snoozed_until <= now, anomaly.c.part_of.is_(None))
        return [_record(row) for row in self._connection.execute(query.order_by(anomaly.c.id)).mappings()]

    def near(self, location_id: int, start: float, stop: float) -> Sequence[AnomalyRecord]:
        """The events of a location, but silences, that touch or overlap [start, stop]; nobody else changes them now."""
        bounds = {"location": location_id, "start": start, "stop": stop}
        return [_record(row) for row in self._connection.execute(_NEAR, bounds).mappings()]

    def change(self, records: Sequence[AnomalyRecord]) -> builtins.list[AnomalyRecord]:
        """Store what has become of events; returns them with the numbers of these changes."""
        if not records:
            return []
        first = take(self._connection, "anomaly", len(records))
        numbered = [replace(record, change=first + i) for i, record in enumerate(records)]
        self._connection.execute(_CHANGE, [_changed(record) for record in numbered])
        return numbered

    def mark(self, records: Sequence[AnomalyRecord]) -> builtins.list[AnomalyRecord]:
        """As `change`, of what is said of events beside what they show: their cells, which may be damaged, stay."""
        if not records:
            return []
        first = take(self._connection, "anomaly", len(records))
        numbered = [replace(record, change=first + i) for i, record in enumerate(records)]
        self._connection.execute(_MARK, [_marked(record) for record in numbered])
        return numbered

    def absorb(self, location_id: int, ids: Sequence[int], into: int) -> None:
        """Have events be part of an older one from now on."""
        mine = (anomaly.c.location_id == location_id) & anomaly.c.id.in_(ids)
        self._connection.execute(update(anomaly).where(mine).values(part_of=into))

    def delete_within(self, location_id: int, start: float, stop: float) -> None:
        """Delete the events of a location, but silences, in [start, stop), with those that are a part of one."""
        mine = (anomaly.c.location_id == location_id) & (anomaly.c.rule != SILENCE)
        within = select(anomaly.c.id).where(mine, anomaly.c.start >= start, anomaly.c.stop <= stop)
        within = within.where(anomaly.c.part_of.is_(None))
        gone = self._connection.execute(within).scalars().all()
        for first in range(0, len(gone), DELETED_AT_ONCE):
            some = gone[first : first + DELETED_AT_ONCE]
            self._connection.execute(
                delete(anomaly).where(mine, or_(anomaly.c.id.in_(some), anomaly.c.part_of.in_(some)))
            )

    def get(self, anomaly_id: int) -> AnomalyRecord:
        """The event, or the older one that it is a part of. Raises AnomalyNotFoundError."""
        return self._of(self._location_of(anomaly_id), anomaly_id)

    def _of(self, location_id: int, anomaly_id: int) -> AnomalyRecord:
        row = self._connection.execute(_BY_ID, {"location": location_id, "id": anomaly_id}).mappings().first()
        if row is None:
            raise AnomalyNotFoundError(anomaly_id)
        return _record(row) if row["part_of"] is None else self._of(location_id, row["part_of"])

    def _location_of(self, anomaly_id: int) -> int:
        """Whose event it is: every further question about it is one about its location."""
        found = self._connection.execute(_OWNER, {"id": anomaly_id}).scalar()
        if found is None:
            raise AnomalyNotFoundError(anomaly_id)
        return int(found)

    def acknowledge(self, anomaly_id: int, by: str, at: float, note: str | None) -> AnomalyRecord:
        """Raises AnomalyNotFoundError. Acknowledging again replaces who, when and the note."""
        known = replace(self.locked(anomaly_id), acknowledged_by=by, acknowledged_at=at, note=note)
        return self.mark([known])[0]

    def locked(self, anomaly_id: int) -> AnomalyRecord:
        """As `get`, and nobody else changes it meanwhile. Raises AnomalyNotFoundError."""
        return self._of(*self._locked(self._location_of(anomaly_id), anomaly_id))

    def _locked(self, location_id: int, anomaly_id: int) -> tuple[int, int]:
        """Location and id of the event, or of the older one that it is a part of, which nobody else changes now."""
        row = self._connection.execute(_LOCKED, {"location": location_id, "id": anomaly_id}).first()
        if row is None:
            raise AnomalyNotFoundError(anomaly_id)
        return (location_id, anomaly_id) if row.part_of is None else self._locked(location_id, row.part_of)


def _query(wanted: AnomalyFilter) -> Select[Any]:
    query = select(anomaly).where(anomaly.c.part_of.is_(None))
    conditions = (
        (wanted.location_id, lambda value: anomaly.c.location_id == value),
        (wanted.after, lambda value: anomaly.c.id > value),
        (wanted.start, lambda value: anomaly.c.stop > value),
        (wanted.stop, lambda value: anomaly.c.start < value),
        (wanted.min_surprise, lambda value: anomaly.c.surprise >= value),
        (wanted.acknowledged, lambda value: anomaly.c.acknowledged.is_(value)),
        (wanted.muted, lambda value: anomaly.c.muted.is_(value)),
    )
    for value, condition in conditions:
        if value is not None:
            query = query.where(condition(value))
    if wanted.search:
        found = select(location.c.id).where(location.c.name.icontains(wanted.search, autoescape=True))
        query = query.where(anomaly.c.location_id.in_(found))
    if wanted.scope.limited:
        visible = select(location.c.id).where(inside(location.c.name, wanted.scope))
        query = query.where(anomaly.c.location_id.in_(visible))
    return query


def _audible(query: Select[Any]) -> Select[Any]:
    """Of events those that people hear of."""
    return query.where(anomaly.c.muted.is_(False), anomaly.c.snoozed_until.is_(None))


def _row(record: AnomalyRecord) -> dict[str, Any]:
    return {
        **{name: getattr(record, name) for name in _COLUMNS},
        "cells": pack_event(record.cells, record.seen),
        "acknowledged": False,
    }


def _changed(record: AnomalyRecord) -> dict[str, Any]:
    return _marked(record) | {"cells": pack_event(record.cells, record.seen)}


def _marked(record: AnomalyRecord) -> dict[str, Any]:
    values = {name: getattr(record, name) for name in (*_GROWS, *_KEPT)}
    values |= {"acknowledged": record.acknowledged_by is not None}
    return values | {"its_location": record.location_id, "its_id": record.id}


def _record(row: RowMapping) -> AnomalyRecord:
    values = {name: row[name] for name in _COLUMNS}
    try:
        cells, seen = unpack_event(row["cells"], f"cells of anomaly {row['id']}")
        return AnomalyRecord(**{**values, "cells": cells}, seen=seen)
    except CorruptChunkError as error:
        return AnomalyRecord(**{**values, "cells": np.empty(0, np.int64)}, damage=error.with_traceback(None))


_OWNER = select(anomaly.c.location_id).where(anomaly.c.id == bindparam("id"))
_ONE = (anomaly.c.location_id == bindparam("location"), anomaly.c.id == bindparam("id"))
_BY_ID = select(anomaly).where(*_ONE)
_LOCKED = select(anomaly.c.part_of).where(*_ONE).with_for_update()
_NEAR = (
    select(anomaly)
    .where(anomaly.c.location_id == bindparam("location"), anomaly.c.part_of.is_(None), anomaly.c.rule != SILENCE)
    .where(anomaly.c.stop >= bindparam("start"), anomaly.c.start <= bindparam("stop"))
    .order_by(anomaly.c.id)
    .with_for_update()
)
_ITS = (anomaly.c.location_id == bindparam("its_location"), anomaly.c.id == bindparam("its_id"))
_MARK = update(anomaly).where(*_ITS).values({name: bindparam(name) for name in (*_GROWS, *_KEPT, "acknowledged")})
_CHANGE = _MARK.values(cells=bindparam("cells"))

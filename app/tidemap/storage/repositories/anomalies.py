"""The repository of anomaly events."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from sqlalchemy import Connection, RowMapping, Select, bindparam, insert, select, update

from tidemap.errors import AnomalyNotFoundError, CorruptChunkError
from tidemap.scope import EVERYWHERE, Scope
from tidemap.storage.blobs import pack_event, unpack_event
from tidemap.storage.counters import take
from tidemap.storage.records import AnomalyRecord
from tidemap.storage.scoping import inside
from tidemap.storage.tables import anomaly, location

_COLUMNS = tuple(field.name for field in fields(AnomalyRecord) if field.name not in ("seen", "damage"))
_GROWS = ("start", "stop", "observed", "probability", "surprise", "confidence", "rule", "revision", "marks")
_KEPT = ("acknowledged_by", "acknowledged_at", "note")


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


class AnomalyRepository:
    """Events in the order in which they were first committed, which is that of their ids."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def append(self, records: Sequence[AnomalyRecord]) -> list[AnomalyRecord]:
        """Store new events; returns them with their ids."""
        if not records:
            return []
        first = take(self._connection, "anomaly", len(records))
        numbered = [replace(record, id=first + i) for i, record in enumerate(records)]
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

    def ids_after(self, after: int, limit: int, scope: Scope) -> Sequence[int]:
        """The next ids, ascending, of locations in scope."""
        query = _query(AnomalyFilter(after=after, scope=scope)).with_only_columns(anomaly.c.id)
        return self._connection.execute(query.order_by(anomaly.c.id).limit(limit)).scalars().all()

    def latest(self) -> int:
        """The greatest id, 0 when there is none."""
        return self._connection.execute(select(anomaly.c.id).order_by(anomaly.c.id.desc()).limit(1)).scalar() or 0

    def near(self, location_id: int, start: float, stop: float) -> Sequence[AnomalyRecord]:
        """The events of a location that touch or overlap [start, stop], which nobody else changes meanwhile."""
        bounds = {"location": location_id, "start": start, "stop": stop}
        return [_record(row) for row in self._connection.execute(_NEAR, bounds).mappings()]

    def change(self, records: Sequence[AnomalyRecord]) -> None:
        """Store what has become of events."""
        if records:
            self._connection.execute(_CHANGE, [_changed(record) for record in records])

    def absorb(self, location_id: int, ids: Sequence[int], into: int) -> None:
        """Have events be part of an older one from now on."""
        mine = (anomaly.c.location_id == location_id) & anomaly.c.id.in_(ids)
        self._connection.execute(update(anomaly).where(mine).values(part_of=into))

    def get(self, anomaly_id: int) -> AnomalyRecord:
        """The event, or the older one that it is a part of. Raises AnomalyNotFoundError."""
        row = self._connection.execute(_BY_ID, {"id": anomaly_id}).mappings().first()
        if row is None:
            raise AnomalyNotFoundError(anomaly_id)
        return _record(row) if row["part_of"] is None else self.get(row["part_of"])

    def acknowledge(self, anomaly_id: int, by: str, at: float, note: str | None) -> AnomalyRecord:
        """Raises AnomalyNotFoundError. Acknowledging again replaces who, when and the note."""
        values = {"acknowledged": True, "acknowledged_by": by, "acknowledged_at": at, "note": note}
        known = self._locked(anomaly_id)
        self._connection.execute(update(anomaly).where(anomaly.c.id == known).values(**values))
        return self.get(known)

    def _locked(self, anomaly_id: int) -> int:
        """The id of the event, or of the older one that it is a part of, which nobody else changes meanwhile."""
        row = self._connection.execute(_LOCKED, {"id": anomaly_id}).first()
        if row is None:
            raise AnomalyNotFoundError(anomaly_id)
        return anomaly_id if row.part_of is None else self._locked(row.part_of)


def _query(wanted: AnomalyFilter) -> Select[Any]:
    query = select(anomaly).where(anomaly.c.part_of.is_(None))
    conditions = (
        (wanted.location_id, lambda value: anomaly.c.location_id == value),
        (wanted.after, lambda value: anomaly.c.id > value),
        (wanted.start, lambda value: anomaly.c.stop > value),
        (wanted.stop, lambda value: anomaly.c.start < value),
        (wanted.min_surprise, lambda value: anomaly.c.surprise >= value),
        (wanted.acknowledged, lambda value: anomaly.c.acknowledged.is_(value)),
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


def _row(record: AnomalyRecord) -> dict[str, Any]:
    return {
        **{name: getattr(record, name) for name in _COLUMNS},
        "cells": pack_event(record.cells, record.seen),
        "acknowledged": False,
    }


def _changed(record: AnomalyRecord) -> dict[str, Any]:
    values = {name: getattr(record, name) for name in (*_GROWS, *_KEPT)}
    values |= {"cells": pack_event(record.cells, record.seen), "acknowledged": record.acknowledged_by is not None}
    return values | {"its_location": record.location_id, "its_id": record.id}


def _record(row: RowMapping) -> AnomalyRecord:
    values = {name: row[name] for name in _COLUMNS}
    try:
        cells, seen = unpack_event(row["cells"], f"cells of anomaly {row['id']}")
        return AnomalyRecord(**{**values, "cells": cells}, seen=seen)
    except CorruptChunkError as error:
        return AnomalyRecord(**{**values, "cells": np.empty(0, np.int64)}, damage=error.with_traceback(None))


_BY_ID = select(anomaly).where(anomaly.c.id == bindparam("id"))
_LOCKED = select(anomaly.c.part_of).where(anomaly.c.id == bindparam("id")).with_for_update()
_NEAR = (
    select(anomaly)
    .where(anomaly.c.location_id == bindparam("location"), anomaly.c.part_of.is_(None))
    .where(anomaly.c.stop >= bindparam("start"), anomaly.c.start <= bindparam("stop"))
    .order_by(anomaly.c.id)
    .with_for_update()
)
_CHANGE = (
    update(anomaly)
    .where(anomaly.c.location_id == bindparam("its_location"), anomaly.c.id == bindparam("its_id"))
    .values({name: bindparam(name) for name in (*_GROWS, *_KEPT, "cells", "acknowledged")})
)

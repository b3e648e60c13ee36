"""The repository of anomaly events."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from sqlalchemy import Connection, RowMapping, Select, insert, select, update

from tidemap.errors import AnomalyNotFoundError, CorruptChunkError
from tidemap.scope import EVERYWHERE, Scope
from tidemap.storage.blobs import pack_cells, unpack_cells
from tidemap.storage.counters import take
from tidemap.storage.records import AnomalyRecord
from tidemap.storage.scoping import inside
from tidemap.storage.tables import anomaly, location

_COLUMNS = tuple(field.name for field in fields(AnomalyRecord) if field.name != "damage")


@dataclass(frozen=True)
class AnomalyFilter:
    """Which events; None leaves a condition out. Times overlap [start, stop)."""

    location_id: int | None = None
    after: int | None = None
    limit: int | None = None
    start: float | None = None
    stop: float | None = None
    min_surprise: float | None = None
    acknowledged: bool | None = None
    scope: Scope = EVERYWHERE


class AnomalyRepository:
    """Events in the order in which they were committed, which is that of their ids."""

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

    def ids_after(self, after: int, limit: int, scope: Scope) -> Sequence[int]:
        """The next ids, ascending, of locations in scope."""
        query = _query(AnomalyFilter(after=after, scope=scope)).with_only_columns(anomaly.c.id)
        return self._connection.execute(query.order_by(anomaly.c.id).limit(limit)).scalars().all()

    def latest(self) -> int:
        """The greatest id, 0 when there is none."""
        return self._connection.execute(select(anomaly.c.id).order_by(anomaly.c.id.desc()).limit(1)).scalar() or 0

    def get(self, anomaly_id: int) -> AnomalyRecord:
        """Raises AnomalyNotFoundError."""
        row = self._connection.execute(select(anomaly).where(anomaly.c.id == anomaly_id)).mappings().first()
        if row is None:
            raise AnomalyNotFoundError(anomaly_id)
        return _record(row)

    def acknowledge(self, anomaly_id: int, by: str, at: float, note: str | None) -> AnomalyRecord:
        """Raises AnomalyNotFoundError. Acknowledging again replaces who, when and the note."""
        values = {"acknowledged": True, "acknowledged_by": by, "acknowledged_at": at, "note": note}
        self._connection.execute(update(anomaly).where(anomaly.c.id == anomaly_id).values(**values))
        return self.get(anomaly_id)


def _query(wanted: AnomalyFilter) -> Select[Any]:
    query = select(anomaly)
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
    if wanted.scope.limited:
        visible = select(location.c.id).where(inside(location.c.name, wanted.scope))
        query = query.where(anomaly.c.location_id.in_(visible))
    return query


def _row(record: AnomalyRecord) -> dict[str, Any]:
    return {
        **{name: getattr(record, name) for name in _COLUMNS},
        "cells": pack_cells(record.cells),
        "acknowledged": False,
    }


def _record(row: RowMapping) -> AnomalyRecord:
    values = {name: row[name] for name in _COLUMNS}
    try:
        return AnomalyRecord(**{**values, "cells": unpack_cells(row["cells"], f"cells of anomaly {row['id']}")})
    except CorruptChunkError as error:
        return AnomalyRecord(**{**values, "cells": np.empty(0, np.int64)}, damage=error.with_traceback(None))

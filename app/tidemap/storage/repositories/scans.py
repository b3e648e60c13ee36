"""The repository of scans."""

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any

from sqlalchemy import Connection, RowMapping, Select, delete, func, insert, select, update

from tidemap.storage.blobs import pack_json, unpack_json
from tidemap.storage.counters import take
from tidemap.storage.records import ScanRecord
from tidemap.storage.tables import scan

MAX_QUARANTINE_BYTES = 64 << 20
"""Bytes in quarantine of one location, as `ScanRecord.n_bytes` counts them; what was put there first gives way."""
MAX_QUARANTINED = 1000
"""Scans in quarantine of one location; the same."""
QUARANTINED = "quarantined"
_LISTED = [column for column in scan.c if column is not scan.c.payload]


class ScanRepository:
    """Scans in the order in which they were committed, which is that of their ids."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def by_key(self, location_id: int, keys: Sequence[str]) -> dict[str, ScanRecord]:
        """The scans of a location that were posted under some idempotency keys."""
        query = select(*_LISTED).where(scan.c.location_id == location_id, scan.c.idempotency_key.in_(keys))
        rows = self._connection.execute(query).mappings() if keys else ()
        return {row["idempotency_key"]: _record(row) for row in rows}

    def append(self, records: Sequence[ScanRecord]) -> list[ScanRecord]:
        """Store new scans; returns them with their ids. What does not fit into quarantine any more leaves it."""
        if not records:
            return []
        first = take(self._connection, "scan", len(records))
        numbered = [replace(record, id=first + i) for i, record in enumerate(records)]
        rows = [{**asdict(record), "registration": pack_json(record.registration)} for record in numbered]
        self._connection.execute(insert(scan), rows)
        for location_id in sorted({record.location_id for record in records if record.payload is not None}):
            self._make_room(location_id)
        return numbered

    def _make_room(self, location_id: int) -> None:
        mine = (scan.c.location_id == location_id) & (scan.c.verdict == QUARANTINED)
        newest = select(scan.c.id, scan.c.n_bytes).where(mine).order_by(scan.c.id.desc()).limit(MAX_QUARANTINED + 1)
        held = 0
        for number, row in enumerate(self._connection.execute(newest).all()):
            held += row.n_bytes
            if held > MAX_QUARANTINE_BYTES or number == MAX_QUARANTINED:
                self._connection.execute(delete(scan).where(mine & (scan.c.id <= row.id)))
                return

    def list(
        self, location_id: int, verdict: str | None = None, after: int | None = None, limit: int | None = None
    ) -> list[ScanRecord]:
        """Newest first, without points; `after` is the last id of the page before."""
        query = select(*_LISTED).where(scan.c.location_id == location_id).order_by(scan.c.id.desc()).limit(limit)
        if verdict is not None:
            query = query.where(scan.c.verdict == verdict)
        if after is not None:
            query = query.where(scan.c.id < after)
        return [_record(row) for row in self._connection.execute(query).mappings()]

    def placed_within(self, location_id: int, start: float, stop: float, limit: int) -> Sequence[ScanRecord]:
        """The newest of [start, stop] whose pose stands, newest first, without points."""
        mine = (scan.c.location_id == location_id) & (scan.c.verdict != QUARANTINED)
        within = mine & (scan.c.time >= start) & (scan.c.time <= stop)
        query = select(*_LISTED).where(within).order_by(scan.c.time.desc(), scan.c.id.desc()).limit(limit)
        return [_record(row) for row in self._connection.execute(query).mappings()]

    def by_source(self, location_id: int, verdict: str) -> dict[str, int]:
        """How many scans of a verdict each source has; '' is of those without a name."""
        own = func.coalesce(scan.c.source, "")
        query = select(own, func.count()).where(scan.c.location_id == location_id, scan.c.verdict == verdict)
        return {row[0]: row[1] for row in self._connection.execute(query.group_by(own))}

    def find(self, location_id: int, scan_id: int) -> ScanRecord | None:
        """A scan with its points, None where there is none."""
        return self._one(select(scan), location_id, scan_id)

    def listed(self, location_id: int, scan_id: int) -> ScanRecord | None:
        """A scan without its points, None where there is none."""
        return self._one(select(*_LISTED), location_id, scan_id)

    def _one(self, query: Select[Any], location_id: int, scan_id: int) -> ScanRecord | None:
        mine = query.where(scan.c.location_id == location_id, scan.c.id == scan_id)
        row = self._connection.execute(mine).mappings().first()
        return None if row is None else _record(row)

    def settle(self, record: ScanRecord) -> bool:
        """Note what became of a scan in quarantine; False, and nothing changed, where it is there no more."""
        mine = (scan.c.location_id == record.location_id) & (scan.c.id == record.id)
        values = {
            "observation": record.observation,
            "verdict": record.verdict,
            "registration": pack_json(record.registration),
            "n_bytes": record.n_bytes,
            "payload": record.payload,
        }
        query = update(scan).where(mine & (scan.c.verdict == QUARANTINED)).values(**values)
        return self._connection.execute(query).rowcount == 1

    def number(self, record: ScanRecord) -> None:
        """Note which observation a scan became."""
        mine = (scan.c.location_id == record.location_id) & (scan.c.id == record.id)
        self._connection.execute(update(scan).where(mine).values(observation=record.observation))

    def delete_within(self, location_id: int, start: float, stop: float, source: str | None) -> int:
        """Drop the scans of [start, stop), of one source or of all of them; how many there were."""
        mine = (scan.c.location_id == location_id) & (scan.c.time >= start) & (scan.c.time < stop)
        if source is not None:
            mine &= scan.c.source == source
        return self._connection.execute(delete(scan).where(mine)).rowcount

    def older(self, location_id: int, before: float, most: int) -> Sequence[int]:
        """The earliest scans that were received before a time."""
        old = select(scan.c.id).where(scan.c.location_id == location_id, scan.c.received_at < before)
        return self._connection.execute(old.order_by(scan.c.id).limit(most)).scalars().all()

    def delete(self, location_id: int, scan_ids: Sequence[int]) -> int:
        """Drop some scans; how many there were."""
        query = delete(scan).where(scan.c.location_id == location_id, scan.c.id.in_(scan_ids))
        return self._connection.execute(query).rowcount


def _record(row: RowMapping) -> ScanRecord:
    values: dict[str, Any] = {"payload": None, **row}
    registration = unpack_json(row["registration"], f"the registration of scan {row['id']}")
    return ScanRecord(**{**values, "registration": registration})

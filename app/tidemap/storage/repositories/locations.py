"""The repository of locations."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from sqlalchemy import Connection, Select, bindparam, delete, func, insert, select, update

from tidemap.errors import LocationExistsError, LocationNotFoundError
from tidemap.scope import EVERYWHERE, Scope
from tidemap.storage.changes import UNCOUNTED
from tidemap.storage.counters import take
from tidemap.storage.records import LocationRecord
from tidemap.storage.scoping import inside
from tidemap.storage.tables import anomaly, revision
from tidemap.storage.tables import location as location_table

# Built once: every request asks the one, and every reader of history asks the other for every chunk.
_BY_NAME = select(location_table).where(location_table.c.name == bindparam("name"))
_BY_ID = select(location_table).where(location_table.c.id == bindparam("id"))
_LOCKED = _BY_ID.with_for_update()
_NAMES = tuple(location_table.c.keys())


@dataclass(frozen=True, slots=True)
class LocationFilter:
    """Which locations, in which order: those whose names contain `search`, or of them those with open anomalies.

    What is not known of a location comes last.
    """

    search: str = ""
    alarmed: bool = False
    sort: Literal["name", "seen", "anomalies"] = "name"
    descending: bool = False
    scope: Scope = EVERYWHERE


@dataclass(frozen=True, slots=True)
class LatestTimes:
    """Unix seconds of a location's latest measurement and of its latest update, None before the first."""

    name: str
    observed: float | None
    updated: float | None


class LocationRepository:
    """Locations by name."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def get(self, name: str) -> LocationRecord:
        """Raises LocationNotFoundError."""
        row = None if "\0" in name else self._connection.execute(_BY_NAME, {"name": name}).first()
        if row is None:
            raise LocationNotFoundError(name)
        return LocationRecord.of(row._mapping)

    def by_id(self, location_id: int) -> LocationRecord:
        """As it is now, whatever its name has become. Raises LocationNotFoundError."""
        row = self._connection.execute(_BY_ID, {"id": location_id}).first()
        if row is None:
            raise LocationNotFoundError(f"number {location_id}")
        return LocationRecord.of(row._mapping)

    def exists(self, location_id: int) -> bool:
        """Whether there still is a location of this id."""
        return self._connection.execute(_BY_ID, {"id": location_id}).first() is not None

    def list(
        self, after: str | None = None, limit: int | None = None, scope: Scope = EVERYWHERE
    ) -> list[LocationRecord]:
        """In order of their names."""
        query = select(location_table).where(inside(location_table.c.name, scope))
        query = query.order_by(location_table.c.name).limit(limit)
        if after is not None:
            query = query.where(location_table.c.name > after)
        return [LocationRecord.of(row) for row in self._connection.execute(query).mappings()]

    def posed(self, scope: Scope = EVERYWHERE) -> Sequence[LocationRecord]:
        """The states in scope that stand somewhere, in order of their names."""
        query = select(location_table).where(location_table.c.kind == "state", location_table.c.pose.is_not(None))
        query = query.where(inside(location_table.c.name, scope)).order_by(location_table.c.name)
        return [LocationRecord.of(row) for row in self._connection.execute(query).mappings()]

    def names(self) -> dict[int, str]:
        """Name by id."""
        rows = self._connection.execute(select(location_table.c.id, location_table.c.name))
        return {row.id: row.name for row in rows}

    def latest(self, limit: int) -> Sequence[LatestTimes]:
        """When the oldest locations, at most so many, were last observed and updated."""
        query = (
            select(location_table.c.name, location_table.c.last_time, revision.c.updated_at)
            .outerjoin(
                revision,
                (revision.c.location_id == location_table.c.id) & (revision.c.revision == location_table.c.revision),
            )
            .order_by(location_table.c.id)
            .limit(limit)
        )
        return [LatestTimes(*row) for row in self._connection.execute(query)]

    def open_anomalies(self) -> dict[int, int]:
        """How many unacknowledged anomalies each location id has, neither muted nor snoozed; without those of none."""
        return {row[0]: row[1] for row in self._connection.execute(select(_OPEN))}

    def open_anomalies_of(self, location_id: int) -> int:
        """How many of those one location has."""
        mine = select(func.count()).where(*_IS_OPEN, anomaly.c.location_id == location_id)
        return int(self._connection.execute(mine).scalar_one())

    def page(self, wanted: LocationFilter, offset: int, limit: int) -> Sequence[tuple[LocationRecord, int]]:
        """Some of them, each with how many open anomalies it has."""
        columns = {"name": location_table.c.name, "seen": location_table.c.last_time, "anomalies": _COUNTED}
        first = columns[wanted.sort]
        order = first.desc() if wanted.descending else first.asc()
        query = _matching(wanted).add_columns(_COUNTED.label("open_anomalies"))
        query = query.order_by(order.nulls_last(), location_table.c.name).offset(offset).limit(limit)
        rows = self._connection.execute(query).mappings()
        return [(LocationRecord.of({name: row[name] for name in _NAMES}), row["open_anomalies"]) for row in rows]

    def count(self, wanted: LocationFilter) -> int:
        """How many there are."""
        return self._connection.execute(select(func.count()).select_from(_matching(wanted).subquery())).scalar() or 0

    def of_ids(self, ids: Collection[int]) -> dict[int, LocationRecord]:
        """Those of some ids that there still are, by id."""
        rows = self._connection.execute(select(location_table).where(location_table.c.id.in_(ids))).mappings()
        return {row["id"]: LocationRecord.of(row) for row in rows}

    def create(self, values: Mapping[str, Any]) -> LocationRecord:
        """Raises LocationExistsError."""
        self._refuse_taken(values["name"])
        self._connection.execute(insert(location_table).values(id=self._next_id(), **values))
        return self.get(values["name"])

    def change(self, name: str, values: Mapping[str, Any]) -> LocationRecord:
        """Raises LocationNotFoundError, LocationExistsError."""
        record = self.get(name)
        new_name = values.get("name", name)
        if new_name != name:
            self._refuse_taken(new_name)
        if values:
            self._connection.execute(update(location_table).where(location_table.c.id == record.id).values(**values))
        return self.get(new_name)

    def lock(self, location_id: int) -> LocationRecord:
        """As it is, and nobody posts or judges until this transaction has ended. Raises LocationNotFoundError."""
        row = self._connection.execute(_LOCKED, {"id": location_id}).first()
        if row is None:
            raise LocationNotFoundError(f"number {location_id}")
        return LocationRecord.of(row._mapping)

    def judged(self, location_id: int, until: float) -> None:
        """Say up to when what is held was judged."""
        mine = location_table.c.id == location_id
        query = update(location_table).where(mine).values(judged_to=until)
        self._connection.execute(query.execution_options(**UNCOUNTED))

    def delete(self, name: str) -> int:
        """With everything that belongs to it; its id. Raises LocationNotFoundError."""
        location_id = self.get(name).id
        self._connection.execute(delete(location_table).where(location_table.c.id == location_id))
        return location_id

    def _next_id(self) -> int:
        """One that no location ever had: SQLite by itself gives that of a deleted one again, and caches go by it."""
        highest = self._connection.execute(select(func.max(location_table.c.id))).scalar() or 0
        return max(take(self._connection, "location"), int(highest) + 1)

    def _refuse_taken(self, name: str) -> None:
        if self._connection.execute(select(location_table.c.id).where(location_table.c.name == name)).first():
            raise LocationExistsError(name)


_IS_OPEN = (
    anomaly.c.acknowledged.is_(False),
    anomaly.c.part_of.is_(None),
    anomaly.c.muted.is_(False),
    anomaly.c.snoozed_until.is_(None),
)
_OPEN = (
    select(anomaly.c.location_id, func.count().label("open"))
    .where(*_IS_OPEN)
    .group_by(anomaly.c.location_id)
    .subquery()
)
_COUNTED = func.coalesce(_OPEN.c.open, 0)


def _matching(wanted: LocationFilter) -> Select[Any]:
    query = select(location_table).outerjoin(_OPEN, _OPEN.c.location_id == location_table.c.id)
    query = query.where(inside(location_table.c.name, wanted.scope))
    if wanted.search:
        query = query.where(location_table.c.name.icontains(wanted.search, autoescape=True))
    return query.where(_COUNTED > 0) if wanted.alarmed else query

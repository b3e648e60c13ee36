"""The repository of sources: which robots measured at what time, of what the log has compacted or pruned."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import ColumnElement, Connection, Table, case, delete, func, select
from sqlalchemy.dialects import postgresql, sqlite

from tidemap.storage.records import LocationRecord
from tidemap.storage.tables import observation, refusal, source

MAX_POSTS = 10_000
"""Posts among which a location's sources are looked for."""
MAX_REFUSED = 100
"""Sources of a location whose refused posts are counted: those with the latest ones."""
MAX_APART_S = 86_400.0
"""After so long without another, refused posts are counted anew."""
UNKNOWN = "*"
"""The source of what was pruned before sources were kept."""
_OWN = func.coalesce(observation.c.source, "")


@dataclass(frozen=True, slots=True)
class Stint:
    """A source measured from `first_time` to `last_time`, both included (Unix s)."""

    name: str
    first_time: float
    last_time: float


@dataclass(frozen=True, slots=True)
class SourceActivity:
    """What a source posted of late: `posts` since a moment, of `kept` in the log; when one was received and measured
    last (Unix s)."""

    name: str
    kept: int
    posts: int
    measurements: int
    last_received: float
    last_measured: float


@dataclass(frozen=True, slots=True)
class Refusals:
    """How many posts of a source were refused since a time (Unix s), when the last was, and why."""

    name: str
    count: int
    since: float
    last_at: float
    reason: str


class SourceRepository:
    """Sources by name, '' of robots without one."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def compacted(self, location: LocationRecord, start: float, stop: float) -> list[Stint]:
        """The observations that are compacted and may have measurements in [start, stop); of each source that the log
        has pruned only the first and the last."""
        log = select(_OWN, observation.c.first_time, observation.c.last_time).where(
            observation.c.location_id == location.id,
            observation.c.id <= location.compacted_seq,
            observation.c.first_time < stop,
            observation.c.last_time >= start,
        )
        pruned = select(source.c.name, source.c.first_time, source.c.last_time).where(
            source.c.location_id == location.id, source.c.first_time < stop, source.c.last_time >= start
        )
        return [Stint(*row) for query in (log, pruned) for row in self._connection.execute(query)]

    def in_log(self, location: LocationRecord, since: float) -> Sequence[SourceActivity]:
        """The sources of the newest MAX_POSTS posts that the log has; those received after `since` are counted."""
        fresh = case((observation.c.received_at >= since, 1), else_=0)
        query = select(
            _OWN,
            func.count(),
            func.sum(fresh),
            func.sum(fresh * observation.c.measurements),
            func.max(observation.c.received_at),
            func.max(observation.c.last_time),
        ).where(
            observation.c.location_id == location.id,
            observation.c.id > location.observation_seq - MAX_POSTS,
        )
        return [SourceActivity(*row) for row in self._connection.execute(query.group_by(_OWN))]

    def refused(self, location_id: int) -> Sequence[Refusals]:
        """Whose posts were refused."""
        columns = (refusal.c[name] for name in Refusals.__slots__)
        return [Refusals(*row) for row in self._connection.execute(select(*columns).where(_refused_at(location_id)))]

    def refuse(self, location_id: int, name: str, at: float, reason: str) -> None:
        """Count a post that was refused."""
        row = {"location_id": location_id, "name": name, "count": 1, "since": at, "last_at": at, "reason": reason}
        self._connection.execute(_count_refused(self._connection.dialect.name), row)
        latest = select(refusal.c.name).where(_refused_at(location_id)).order_by(refusal.c.last_at.desc())
        older = refusal.c.name.not_in(latest.limit(MAX_REFUSED).scalar_subquery())
        self._connection.execute(delete(refusal).where(_refused_at(location_id), older))

    def keep(self, location_id: int, through: int) -> None:
        """Remember whose observations, up to number `through`, are about to leave the log."""
        first, last = func.min(observation.c.first_time), func.max(observation.c.last_time)
        leaving = select(_OWN.label("name"), first.label("first_time"), last.label("last_time")).where(
            observation.c.location_id == location_id, observation.c.id <= through
        )
        for row in self._connection.execute(leaving.group_by(_OWN)).mappings().all():
            self._connection.execute(_keep(self._connection.dialect.name), {"location_id": location_id, **row})


_INSERT: Mapping[str, Callable[[Table], postgresql.Insert | sqlite.Insert]] = {
    "postgresql": postgresql.insert,
    "sqlite": sqlite.insert,
}


def _refused_at(location_id: int) -> ColumnElement[bool]:
    return refusal.c.location_id == location_id


def _count_refused(dialect: str) -> Any:
    """One more, or the first of its source since a while."""
    new = _INSERT[dialect](refusal)
    before, now = refusal.c, new.excluded
    again = now.last_at - before.last_at <= MAX_APART_S
    counted = {
        "count": case((again, before.count + 1), else_=1),
        "since": case((again, before.since), else_=now.since),
        "last_at": now.last_at,
        "reason": now.reason,
    }
    return new.on_conflict_do_update(index_elements=[before.location_id, before.name], set_=counted)


def _keep(dialect: str) -> Any:
    """Widen the time of a source, or begin it."""
    new = _INSERT[dialect](source)
    before, now = source.c, new.excluded
    wider = {
        "first_time": case((now.first_time < before.first_time, now.first_time), else_=before.first_time),
        "last_time": case((now.last_time > before.last_time, now.last_time), else_=before.last_time),
    }
    return new.on_conflict_do_update(index_elements=[source.c.location_id, source.c.name], set_=wider)

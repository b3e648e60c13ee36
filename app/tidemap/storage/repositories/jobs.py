"""The repository of jobs."""

import json
from collections.abc import Sequence
from typing import Any

from sqlalchemy import ColumnElement, Connection, RowMapping, delete, insert, null, select, update

from tidemap.errors import JobNotFoundError
from tidemap.scope import EVERYWHERE, Scope
from tidemap.storage.blobs import pack_json, unpack_json
from tidemap.storage.counters import take
from tidemap.storage.records import JobRecord
from tidemap.storage.scoping import inside
from tidemap.storage.tables import job
from tidemap.storage.tables import location as location_table

_ROWS = select(job, location_table.c.name.label("location")).join(
    location_table, location_table.c.id == job.c.location_id
)

_QUEUED = select(job.c.id).where(job.c.state == "queued").limit(1)


class JobRepository:
    """Jobs in the order in which they were asked for."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def create(self, location_id: int, kind: str, request: dict[str, Any], now: float) -> JobRecord:
        """Queue a job."""
        number = take(self._connection, "job")
        values = {"location_id": location_id, "id": number, "kind": kind, "state": "queued", "progress": 0.0}
        self._connection.execute(insert(job).values(request=json.dumps(request), created_at=now, **values))
        return self._of(location_id, number)

    def get(self, job_id: int) -> JobRecord:
        """Raises JobNotFoundError."""
        owner = self._location_of(job_id)
        if owner is None:
            raise JobNotFoundError(job_id)
        return self._of(owner, job_id)

    def _of(self, location_id: int, job_id: int) -> JobRecord:
        row = self._connection.execute(_ROWS.where(*_one(location_id, job_id))).mappings().first()
        if row is None:
            raise JobNotFoundError(job_id)
        return _record(row)

    def _location_of(self, job_id: int) -> int | None:
        """Whose job it is: every further question about it is one about its location."""
        return self._connection.execute(select(job.c.location_id).where(job.c.id == job_id)).scalar()

    def list(
        self, after: int | None, limit: int, location_name: str | None = None, scope: Scope = EVERYWHERE
    ) -> list[JobRecord]:
        """Newest first; `after` is the last id of the page before."""
        query = _ROWS.where(inside(location_table.c.name, scope)).order_by(job.c.id.desc()).limit(limit)
        if after is not None:
            query = query.where(job.c.id < after)
        if location_name is not None:
            query = query.where(location_table.c.name == location_name)
        return [_record(row) for row in self._connection.execute(query).mappings()]

    def waiting(self) -> bool:
        """Whether any job is queued."""
        return self._connection.execute(_QUEUED).first() is not None

    def claim(self, now_running: frozenset[int]) -> JobRecord | None:
        """The oldest queued job whose location is not among those running here, set to running."""
        query = _ROWS.where(job.c.state == "queued").order_by(job.c.id)
        if now_running:
            query = query.where(job.c.location_id.not_in(now_running))
        for row in self._connection.execute(query.limit(8)).mappings():
            if self._change(row["location_id"], row["id"], "queued", {"state": "running"}):
                return self._of(row["location_id"], row["id"])
        return None

    def transition(self, job_id: int, expected: str, **values: Any) -> bool:
        """Change a job that is in the expected state, `result` as plain JSON; False when it is not."""
        if "result" in values:
            values["result"] = pack_json(values["result"])
        if "finished_at" in values:
            values.setdefault("error", None)
        owner = self._location_of(job_id)
        return owner is not None and self._change(owner, job_id, expected, values)

    def _change(self, location_id: int, job_id: int, expected: str, values: dict[str, Any]) -> bool:
        query = update(job).where(*_one(location_id, job_id), job.c.state == expected).values(**values)
        return self._connection.execute(query).rowcount == 1

    def progress(self, location_id: int, job_id: int, progress: float) -> None:
        """How far a running job of a location is, 0 to 1."""
        self._connection.execute(update(job).where(*_one(location_id, job_id)).values(progress=progress))

    def note_waiting(self, job_id: int, reason: str | None) -> bool:
        """Store what keeps a job that has not ended from going on; whether that is news."""
        owner = self._location_of(job_id)
        news = job.c.finished_at.is_(None), job.c.error.is_distinct_from(null() if reason is None else reason)
        query = None if owner is None else update(job).where(*_one(owner, job_id), *news).values(error=reason)
        return query is not None and self._connection.execute(query).rowcount == 1

    def finished_before(self, location_id: int, time: float, kept: int, most: int) -> Sequence[int]:
        """The jobs of a location that ended before a time, at most so many, but for its `kept` newest that ended."""
        ended = (
            select(job.c.id, job.c.finished_at)
            .where(job.c.location_id == location_id, job.c.finished_at.is_not(None))
            .order_by(job.c.id.desc())
            .offset(kept)
            .subquery()
        )
        query = select(ended.c.id).where(ended.c.finished_at < time).order_by(ended.c.id).limit(most)
        return self._connection.execute(query).scalars().all()

    def delete(self, location_id: int, jobs: Sequence[int]) -> int:
        """Drop jobs; how many rows."""
        mine = (job.c.location_id == location_id) & job.c.id.in_(jobs)
        return self._connection.execute(delete(job).where(mine)).rowcount

    def requeue_running(self) -> None:
        """After a restart: what was running runs again."""
        self._connection.execute(update(job).where(job.c.state == "running").values(state="queued", progress=0.0))


def _one(location_id: int, job_id: int) -> tuple[ColumnElement[bool], ...]:
    return job.c.location_id == location_id, job.c.id == job_id


def _record(row: RowMapping) -> JobRecord:
    values = {name: row[name] for name in JobRecord.__dataclass_fields__ if name != "waiting"}
    values["request"] = json.loads(row["request"])
    # One column: a job that has ended waits for nothing, and one that has not did not fail yet.
    values["waiting"] = None
    if row["finished_at"] is None:
        values["waiting"], values["error"] = row["error"], None
    values["result"] = row["result"] and unpack_json(row["result"], f"the result of job {row['id']}")
    return JobRecord(**values)

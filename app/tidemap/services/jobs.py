"""Jobs: asking for long work, following it, running it."""

import logging
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from typing import Any

from tidemap.errors import (
    BusyError,
    DomainError,
    JobFinishedError,
    JobNotFoundError,
    refuse_reversed,
)
from tidemap.events.messages import EventMessage
from tidemap.scope import EVERYWHERE, Scope
from tidemap.services.context import Context
from tidemap.services.update import UpdateRequest, run_update
from tidemap.services.update_task import Executor
from tidemap.storage.records import JobRecord, RevisionRecord
from tidemap.storage.work import Work

log = logging.getLogger(__name__)
PROGRESS_STEP = 0.02


def request_update(ctx: Context, name: str, request: UpdateRequest) -> JobRecord:
    """Queue an update. Raises LocationNotFoundError, InvalidInputError."""
    refuse_reversed(request.start, request.stop)
    record = ctx.store.write(
        lambda work: work.jobs.create(work.locations.get(name).id, "update", asdict(request), ctx.clock())
    )
    _publish(ctx, record)
    return record


def get_job(ctx: Context, job_id: int) -> JobRecord:
    """Raises JobNotFoundError."""
    with ctx.store.read() as work:
        return work.jobs.get(job_id)


def list_jobs(ctx: Context, after: int | None, limit: int, scope: Scope = EVERYWHERE) -> list[JobRecord]:
    """Those of locations in scope, newest first."""
    with ctx.store.read() as work:
        return work.jobs.list(after, limit, scope=scope)


def cancel_job(ctx: Context, job_id: int) -> JobRecord:
    """Cancel a queued job. Raises JobNotFoundError, JobFinishedError when it is past that."""

    def cancel(work: Work) -> JobRecord:
        cancelled = work.jobs.transition(job_id, "queued", state="cancelled", finished_at=ctx.clock())
        record = work.jobs.get(job_id)
        if not cancelled:
            raise JobFinishedError(job_id, record.state)
        return record

    record = ctx.store.write(cancel)
    _publish(ctx, record)
    return record


def claim_job(ctx: Context, busy: frozenset[int]) -> JobRecord | None:
    """The next queued job of a location that is not busy, now running."""
    with ctx.store.read() as work:
        if not work.jobs.waiting():
            return None
    record = ctx.store.write(lambda work: work.jobs.claim(busy))
    if record is not None:
        _publish(ctx, record)
    return record


def requeue_interrupted(ctx: Context) -> None:
    """Jobs that are said to be running, though nobody runs them, run again."""
    ctx.store.write(lambda work: work.jobs.requeue_running())


def note_waiting(ctx: Context, record: JobRecord, reason: str | None) -> None:
    """Say in a job what it waits for, or with None that it goes on; where that cannot be stored, it is said later."""
    with suppress(BusyError):
        if ctx.store.write(lambda work: work.jobs.note_waiting(record.id, reason)):
            _publish_now(ctx, record)


def run_job(ctx: Context, record: JobRecord, executor: Executor) -> bool:
    """Run a claimed job to its end; whether it did what it was to. BusyError leaves it running, to run again later."""

    def done(work: Work, revision: RevisionRecord) -> None:
        # With the revision: a job that dies between the two would run again, and publish another one.
        ended = {"state": "done", "progress": 1.0, "result": _result(revision), "finished_at": ctx.clock()}
        work.jobs.transition(record.id, "running", **ended)

    try:
        request = UpdateRequest(**record.request)
        revision = run_update(ctx, record.location_id, request, executor, _reporter(ctx, record), done)
    except BusyError:
        raise
    except DomainError as error:
        _fail(ctx, record, str(error))
    except Exception as error:
        log.exception("job %d failed", record.id)
        _fail(ctx, record, f"{type(error).__name__}: {error}")
    else:
        _publish_now(ctx, record)
        ctx.bus.publish(EventMessage("update", record.location, revision.revision, ctx.clock(), _result(revision)))
        return True
    return False


def _result(revision: RevisionRecord) -> dict[str, Any]:
    return {name: getattr(revision, name) for name in ("revision", "estimator", "order", "accuracy", "selection")}


def _reporter(ctx: Context, record: JobRecord) -> Callable[[float], None]:
    reported = 0.0

    def report(progress: float) -> None:
        nonlocal reported
        if progress - reported >= PROGRESS_STEP and progress < 1:
            reported = progress
            with suppress(BusyError):
                ctx.store.submit(lambda work: work.jobs.progress(record.location_id, record.id, progress))

    return report


def _fail(ctx: Context, record: JobRecord, error: str) -> None:
    ended = {"state": "failed", "error": error, "finished_at": ctx.clock()}
    ctx.store.write(lambda work: work.jobs.transition(record.id, "running", **ended))
    _publish_now(ctx, record)


def _publish_now(ctx: Context, record: JobRecord) -> None:
    try:
        with ctx.store.read() as work:
            _publish(ctx, work.jobs.get(record.id))
    except JobNotFoundError:
        log.info("location %r was deleted while job %d ran", record.location, record.id)


def _publish(ctx: Context, record: JobRecord) -> None:
    data = {"job": record.kind, "state": record.state, "progress": record.progress, "waiting": record.waiting}
    ctx.bus.publish(EventMessage("job", record.location, record.id, ctx.clock(), data))

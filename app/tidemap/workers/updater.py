"""The updater: runs queued jobs and refits locations whose history has grown."""

import math
import time
from dataclasses import asdict

from tidemap.events.messages import EventMessage
from tidemap.events.subscription import EventFilter, listen
from tidemap.services.context import Context
from tidemap.services.jobs import claim_job, note_waiting, request_update, requeue_interrupted, run_job
from tidemap.services.update import UpdateRequest
from tidemap.services.update_task import Executor
from tidemap.storage.records import JobRecord, LocationRecord, RevisionRecord
from tidemap.workers.election import LeaderElection, LeaderTerm
from tidemap.workers.executors import Limited, open_executor
from tidemap.workers.priority import give_way
from tidemap.workers.retries import Retries
from tidemap.workers.worker import Worker

JOBS = EventFilter(kinds=frozenset({"job"}))
POLL_S = 1.0
"""How often to look for jobs, which other processes queue without a word."""


class Updater:
    """One thread that takes job after job while this process leads; chunks run where the executor has them run."""

    def __init__(self, ctx: Context, election: LeaderElection) -> None:
        self._ctx = ctx
        self._election = election
        self._executor = open_executor(ctx)
        self._executor.on_wait(self._note_waiting)
        self._running: tuple[Context, JobRecord] | None = None
        self._worker = Worker("updater", min(POLL_S, ctx.settings.updater_interval_s), self._round)
        self._settled: LeaderTerm | None = None
        self._looked = -math.inf
        self._retries = Retries(ctx.settings.update_rest_s, ctx.clock)
        self._asked: dict[int, float] = {}
        self._unsubscribe = listen(ctx.bus, JOBS, self._listen)
        election.on_begin(self._worker.wake)

    def start(self) -> None:
        """Begin; jobs that an earlier leader left running run again."""
        self._worker.start()

    def request_stop(self) -> None:
        """Begin nothing more."""
        self._unsubscribe()
        self._worker.request_stop()
        self._executor.request_stop()

    def stop(self) -> None:
        """Finish the tasks at hand and end."""
        self.request_stop()
        self._executor.close()
        self._worker.join()

    def alive(self) -> bool:
        """Whether it is at work."""
        return self._worker.alive()

    def _listen(self, message: EventMessage) -> None:
        if message.data.get("state") == "queued":
            self._worker.wake()

    def _round(self) -> None:
        give_way()
        if self._ctx.store.outage() is not None:
            # Nobody may post to a server that is not ready: it has to find out by itself when it can write again.
            self._ctx.store.write(lambda work: None)
        if (term := self._election.term) is None:
            return
        ctx = term.limit(self._ctx)
        if self._settled is not term:
            # Also a job that was claimed, or ended, when the database went away: nobody knows whether that is stored.
            requeue_interrupted(ctx)
        self._settled = None
        self._run_jobs(ctx, Limited(self._executor, term.check))
        if self._ctx.settings.updater and time.monotonic() - self._looked >= self._ctx.settings.updater_interval_s:
            self._find_work(ctx)
        self._settled = term

    def _run_jobs(self, ctx: Context, executor: Executor) -> None:
        self._worker.check()
        while (job := claim_job(ctx, frozenset())) is not None:
            self._running = ctx, job
            report = self._retries.worked if run_job(ctx, job, executor) else self._retries.failed
            if job.request == asdict(UpdateRequest()):
                report(job.location_id)
            self._worker.check()

    def _note_waiting(self, reason: str | None) -> None:
        """Only jobs have tasks: it is the one at hand that waits."""
        if self._running is not None:
            note_waiting(*self._running, reason)

    def _find_work(self, ctx: Context) -> None:
        self._looked = time.monotonic()
        with ctx.store.read() as work:
            locations, revisions = work.locations.list(), work.spectra.current()
        now = ctx.clock()
        urgent_first = sorted(locations, key=lambda each: urgency(each, revisions.get(each.id), now), reverse=True)
        self._worker.for_each(
            urgent_first, lambda location: self._ask_for_update(ctx, location, revisions.get(location.id))
        )

    def _ask_for_update(self, ctx: Context, location: LocationRecord, revision: RevisionRecord | None) -> None:
        now = ctx.clock()
        rested = now - self._asked.get(location.id, -math.inf) >= ctx.settings.update_rest_s
        if rested and self._retries.due(location.id) and is_due(ctx, location, revision):
            self._asked[location.id] = now
            request_update(ctx, location.name, UpdateRequest())


def is_due(ctx: Context, location: LocationRecord, revision: RevisionRecord | None) -> bool:
    """Whether the history has grown, or lost, enough since the last update, or grown enough for the first one."""
    settings = ctx.settings
    if revision is None:
        return location.observations >= settings.update_samples
    grown = abs(location.observations - revision.measurements)
    age_s = ctx.clock() - revision.updated_at
    enough = grown >= settings.update_growth * revision.measurements or (grown and age_s >= settings.update_latest_s)
    return bool(enough) and age_s >= settings.update_rest_s


def urgency(location: LocationRecord, revision: RevisionRecord | None, now: float) -> float:
    """How early a location is to be updated where several are due: the stale first, and the small before the large.

    Seconds since its last update a chunk; infinite where it has none yet.
    """
    return math.inf if revision is None else (now - revision.updated_at) / location.n_chunks

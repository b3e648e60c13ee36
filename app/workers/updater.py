"""The updater: runs queued jobs, refits locations whose history has grown, compacts long logs."""

import logging
import math
from threading import Event, Thread

from app.errors import BusyError, ShuttingDownError, TidemapError
from app.events.messages import Message
from app.services.context import Context
from app.services.history import compact
from app.services.jobs import claim_job, request_update, requeue_interrupted, run_job
from app.services.pruning import prune
from app.services.update import UpdateRequest
from app.storage.records import LocationRecord, RevisionRecord
from app.workers.executors import LocalExecutor

log = logging.getLogger(__name__)
PRUNE_EVERY_S = 3600.0
COMPACT_POSTS = 64
COMPACT_MEASUREMENTS = 1_000_000
"""A log that is longer is compacted before its location is due for an update: whoever reads the history unpacks it."""


class Updater:
    """One thread that takes job after job; an update's chunks run on the executor's threads."""

    def __init__(self, ctx: Context) -> None:
        self._ctx = ctx
        self._wake = Event()
        self._stop = Event()
        self._executor = LocalExecutor(ctx.settings.update_threads)
        self._interrupted = True
        self._asked: dict[int, float] = {}
        self._pruned = -math.inf
        self._thread = Thread(target=self._loop, name="tidemap-updater", daemon=True)
        self._unsubscribe = ctx.bus.subscribe(self._listen)

    def start(self) -> None:
        """Begin; jobs that a stopped process left running run again."""
        self._thread.start()

    def stop(self) -> None:
        """Finish the tasks at hand and end."""
        self._unsubscribe()
        self._stop.set()
        self._wake.set()
        self._executor.close()
        if self._thread.is_alive():
            self._thread.join()

    def alive(self) -> bool:
        """Whether it is at work."""
        return self._thread.is_alive()

    def _listen(self, message: Message) -> None:
        if message.kind == "job" and message.data.get("state") == "queued":
            self._wake.set()

    def _loop(self) -> None:
        while not self._stop.is_set():
            try:
                self._run_jobs()
                if self._ctx.settings.updater and not self._stop.is_set():
                    self._look_around()
                    self._prune()
            except ShuttingDownError:
                return
            except BusyError as error:
                self._interrupted = True
                log.debug("the updater waits: %s", error.title)
            except Exception:
                self._interrupted = True
                log.exception("the updater failed and goes on")
            self._wake.wait(self._ctx.settings.updater_interval_s)
            self._wake.clear()

    def _run_jobs(self) -> None:
        if self._interrupted:
            # Also a job that was claimed, or ended, when the database went away: nobody knows whether that is stored.
            requeue_interrupted(self._ctx)
            self._interrupted = False
        while not self._stop.is_set() and (job := claim_job(self._ctx, frozenset())) is not None:
            run_job(self._ctx, job, self._executor)

    def _look_around(self) -> None:
        with self._ctx.store.read() as work:
            places, revisions, waiting = work.locations.list(), work.spectra.current(), work.observations.waiting()
        for place in places:
            if self._stop.is_set():
                return
            try:
                self._care_for(place, revisions.get(place.id), waiting.get(place.id, 0))
            except BusyError:
                raise
            except TidemapError as error:
                log.warning("location %s: %s", place.name, error)
            except Exception:
                log.exception("location %s: its care failed", place.name)

    def _prune(self) -> None:
        now = self._ctx.clock()
        if now - self._pruned >= PRUNE_EVERY_S and not self._stop.is_set():
            self._pruned = now
            if pruned := prune(self._ctx, lambda: not self._stop.is_set()):
                log.info("%d rows of old posts and jobs were pruned", pruned)

    def _care_for(self, place: LocationRecord, revision: RevisionRecord | None, waiting: int) -> None:
        now = self._ctx.clock()
        rested = now - self._asked.get(place.id, -math.inf) >= self._ctx.settings.update_rest_s
        if rested and is_due(self._ctx, place, revision):
            self._asked[place.id] = now
            request_update(self._ctx, place.name, UpdateRequest())
        elif place.observation_seq - place.compacted_seq >= COMPACT_POSTS or waiting >= COMPACT_MEASUREMENTS:
            compact(self._ctx, place)


def is_due(ctx: Context, place: LocationRecord, revision: RevisionRecord | None) -> bool:
    """Whether the history has grown enough since the last update, or for the first one."""
    settings = ctx.settings
    if place.first_time is None or place.last_time is None:
        return False
    if revision is None:
        return (place.last_time - place.first_time) / place.interval_s >= settings.update_samples
    grown = place.measurements - revision.measurements
    age_s = ctx.clock() - revision.updated_at
    enough = grown >= settings.update_growth * revision.measurements or (grown and age_s >= settings.update_latest_s)
    return bool(enough) and age_s >= settings.update_rest_s

"""The watcher: judges what locations hold while nobody says anything, and who is silent; says what has ended."""

import time
from collections.abc import Callable

from tidemap.services.context import Context
from tidemap.services.ending import end_events
from tidemap.services.silence import Silences
from tidemap.services.snoozing import end_snoozes
from tidemap.services.standing import judge_standing, standing_locations
from tidemap.storage.records import LocationRecord
from tidemap.workers.election import LeaderElection, LeaderTerm
from tidemap.workers.maintenance import MaintenanceWorker

WATCH_S = 5.0
"""How often to look."""
SHARE = 20
"""Times as long as it took to judge a location it rests, so that a large one does not keep a processor busy."""


class Watcher(MaintenanceWorker):
    """One thread, at work while this process leads."""

    def __init__(self, ctx: Context, election: LeaderElection) -> None:
        super().__init__(ctx, election, "watcher", min(WATCH_S, ctx.settings.updater_interval_s), self._round)
        self._due: dict[int, float] = {}
        self._term: LeaderTerm | None = None
        self._silences = Silences()

    def _round(self) -> None:
        if (term := self._election.term) is None:
            return
        ctx, check = term.limit(self._ctx), self._worker.check_with(term.check)
        if term is not self._term:
            self._term, self._silences = term, Silences()
        locations = standing_locations(ctx)
        self._due = {each.id: self._due.get(each.id, 0.0) for each in locations}
        due = [each for each in locations if time.monotonic() >= self._due[each.id]]
        self._worker.for_each(due, lambda location: self._judge(ctx, location, check))
        self._end(ctx)
        self._silences.watch(ctx, check)

    def _end(self, ctx: Context) -> None:
        """Say which events have ended, and whose snooze has."""
        with ctx.store.read() as work:
            lasting = work.anomalies.lasting()
            locations = [each for each in work.locations.list() if each.id in lasting] if lasting else []
        self._worker.for_each(locations, lambda location: end_events(ctx, location, lasting[location.id]))
        end_snoozes(ctx)

    def _judge(self, ctx: Context, location: LocationRecord, check: Callable[[], None]) -> None:
        begun = time.monotonic()
        try:
            while judge_standing(ctx, location, check):
                pass
        finally:
            took = time.monotonic() - begun
            self._due[location.id] = begun + took * SHARE

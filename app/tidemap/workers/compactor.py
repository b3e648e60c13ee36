"""The compactor: keeps the logs of all locations short, beside the updater and whatever that is busy with."""

import logging
import math
import time
from collections.abc import Callable

from tidemap.errors import BusyError
from tidemap.events.messages import EventMessage
from tidemap.events.subscription import EventFilter, listen
from tidemap.services.compaction import compact, forget_everywhere
from tidemap.services.context import Context
from tidemap.services.pruning import prune
from tidemap.storage.records import LocationRecord
from tidemap.workers.election import LeaderElection, LeaderTerm
from tidemap.workers.maintenance import MaintenanceWorker
from tidemap.workers.priority import give_way
from tidemap.workers.retries import Retries

log = logging.getLogger(__name__)
POSTS = EventFilter(kinds=frozenset({"observation"}))
PRUNE_EVERY_S = 3600.0
COMPACT_POSTS = 256
COMPACT_MEASUREMENTS = 2_000_000
"""A longer log is compacted, because every reader of the history unpacks it. Each compaction rewrites some segments:
to compact more often writes more, and takes more time from others."""
LATE_MEASUREMENTS = 6_000_000
"""When more wait to be compacted, posts are slowed down: a question has to read them all."""
FAILED_S = 10.0
"""How long a location rests after its compaction has failed, and twice as long each time that it fails again."""
STALLED_S = 600.0
"""Posts do not wait for a log that nobody has compacted for so long: the leader must have failed."""
SLOWEST_S = 0.25
"""How long the writer rests at most after a group of posts."""


class Compactor(MaintenanceWorker):
    """One thread. The more comes in while it works, the more it compacts at once, and the less work a post is.

    Where another process leads it compacts nothing, but it slows posts down while that one is late.
    """

    def __init__(self, ctx: Context, election: LeaderElection) -> None:
        super().__init__(ctx, election, "compactor", ctx.settings.updater_interval_s, self._round)
        self._retries = Retries(FAILED_S, time.monotonic)
        self._stood: dict[tuple[int, int], float] = {}
        self._waiting = 0
        self._come_in = 0
        self._pruned = -math.inf
        self._unsubscribe: Callable[[], None] = lambda: None

    def start(self) -> None:
        """Begin, unless the settings leave histories alone."""
        if self._ctx.settings.updater:
            self._unsubscribe = listen(self._ctx.bus, POSTS, self._listen)
        super().start()

    def request_stop(self) -> None:
        """Leave the round at hand; nothing of it is stored."""
        self._unsubscribe()
        self._ctx.store.slow_down(0)
        super().request_stop()

    def _listen(self, message: EventMessage) -> None:
        self._come_in += message.data["measurements"]
        if self._come_in >= COMPACT_MEASUREMENTS:
            self._worker.wake()
        self._pace()

    def _pace(self) -> None:
        self._ctx.store.slow_down(slowed_s(self._waiting + self._come_in))

    def _round(self) -> None:
        give_way()
        # Before they are counted: what comes in meanwhile is rather counted twice than not at all.
        self._come_in = 0
        with self._ctx.store.read() as work:
            locations, waiting = work.locations.list(), work.observations.waiting()
        long = [location for location in locations if is_long(location, waiting.get(location.id, 0))]
        self._waiting = sum(waiting.get(location.id, 0) for location in self._moving(long))
        self._worker.check()
        # What came in since it was counted was paced by the count before.
        self._pace()
        if (term := self._election.term) is not None:
            self._work(term, [location for location in long if self._retries.due(location.id)])

    def _moving(self, long: list[LocationRecord]) -> list[LocationRecord]:
        """Of locations with long logs those that posts wait for: where compaction fails that would be in vain."""
        now, stood = time.monotonic(), self._stood
        self._stood = {key: stood.get(key, now) for key in ((location.id, location.compacted_seq) for location in long)}
        return [
            location
            for location in long
            if not self._retries.fails(location.id)
            and now - self._stood[location.id, location.compacted_seq] < STALLED_S
        ]

    def _work(self, term: LeaderTerm, long: list[LocationRecord]) -> None:
        ctx, check = term.limit(self._ctx), self._worker.check_with(term.check)
        self._worker.for_each(long, lambda location: self._compact(ctx, location, check))
        self._prune(ctx, check)

    def _compact(self, ctx: Context, location: LocationRecord, check: Callable[[], None]) -> None:
        try:
            compact(ctx, location, check)
        except BusyError:
            raise
        except Exception:
            self._retries.failed(location.id)
            raise
        self._retries.worked(location.id)

    def _prune(self, ctx: Context, check: Callable[[], None]) -> None:
        now = ctx.clock()
        if now - self._pruned >= PRUNE_EVERY_S:
            self._pruned = now
            forget_everywhere(ctx, check)
            if pruned := prune(ctx, check):
                log.info("%d rows of old posts and jobs were pruned", pruned)


def is_long(location: LocationRecord, waiting: int) -> bool:
    """Whether a location's log with so many waiting measurements is to be compacted."""
    return location.observation_seq - location.compacted_seq >= COMPACT_POSTS or waiting >= COMPACT_MEASUREMENTS


def slowed_s(waiting: int) -> float:
    """How long the writer is to rest after a group: the longer, the more measurements wait to be compacted.

    >>> slowed_s(6_000_000), slowed_s(9_000_000), slowed_s(60_000_000)
    (0.0, 0.125, 0.25)
    """
    return min(SLOWEST_S, max(0.0, SLOWEST_S * (waiting / LATE_MEASUREMENTS - 1)))

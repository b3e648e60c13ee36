"""Leader election: one process at a time does the background work of a database."""

import logging
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from threading import Event

from tidemap.errors import NotLeaderError
from tidemap.services.context import Context
from tidemap.storage.lock import Lock, open_lock
from tidemap.storage.work import Work
from tidemap.workers.worker import Worker

log = logging.getLogger(__name__)
BEAT_S = 1.0
"""How often to look whether the lock is free, and whether it is still held."""


@dataclass(frozen=True, slots=True, eq=False)
class LeaderTerm:
    """A time as the leader. Once it is over, nothing of its work is stored, even before this process knows."""

    number: int
    _over: Event = field(default_factory=Event)

    def check(self) -> None:
        """Raises NotLeaderError once it is known to be over."""
        if self._over.is_set():
            raise NotLeaderError

    def end(self) -> None:
        """It is over."""
        self._over.set()

    def limit(self, ctx: Context) -> Context:
        """The same context, but writes after the end of the term are refused."""
        return replace(ctx, store=ctx.store.guarded(self._confirm), term=self.number)

    def _confirm(self, work: Work) -> None:
        try:
            work.terms.confirm(self.number)
        except NotLeaderError:
            self.end()
            raise


class LeaderElection:
    """One thread that takes the lock when it is free, and checks every second that it still holds it."""

    def __init__(self, ctx: Context) -> None:
        self._lock: Lock = open_lock(ctx.settings.url)
        self._worker = Worker("watch", BEAT_S, self._beat)
        self._term: LeaderTerm | None = None
        self._listeners: tuple[Callable[[], None], ...] = ()

    @property
    def term(self) -> LeaderTerm | None:
        """The term of this process; None where another process leads, or none can."""
        return self._term

    def on_begin(self, listener: Callable[[], None]) -> None:
        """Call `listener`, which only takes note, whenever a term begins."""
        self._listeners += (listener,)

    def start(self) -> None:
        """Begin to look after it."""
        self._worker.start()

    def stop(self) -> None:
        """Leave the work to others. Stop what works in the term first."""
        self._worker.request_stop()
        self._worker.join()
        self._leave()

    def alive(self) -> bool:
        """Whether it is looked after."""
        return self._worker.alive()

    def _beat(self) -> None:
        if self._term is not None:
            if self._goes_on(self._term):
                return
            self._leave()
        number = self._lock.take()
        if number is not None:
            self._term = LeaderTerm(number)
            level = logging.INFO if self._lock.shared else logging.DEBUG
            log.log(level, "this process does the background work from now on (term %d)", number)
            for listener in self._listeners:
                listener()

    def _goes_on(self, term: LeaderTerm) -> bool:
        try:
            term.check()
            held = self._lock.held()
        except NotLeaderError:
            held = False
        if not held:
            log.warning("this process does the background work no longer (term %d): its lock was lost", term.number)
        return held

    def _leave(self) -> None:
        if self._term is not None:
            self._term.end()
            self._term = None
        self._lock.release()

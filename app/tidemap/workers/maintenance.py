"""What the workers that look after locations have in common: when they work, and how they begin and end."""

from collections.abc import Callable

from tidemap.services.context import Context
from tidemap.workers.election import LeaderElection
from tidemap.workers.worker import Worker


class MaintenanceWorker:
    """One thread that calls `round_` every `interval_s` seconds and when a term begins, unless the settings forbid."""

    def __init__(
        self, ctx: Context, election: LeaderElection, name: str, interval_s: float, round_: Callable[[], None]
    ) -> None:
        self._ctx = ctx
        self._election = election
        self._worker = Worker(name, interval_s, round_)
        election.on_begin(self._worker.wake)

    def start(self) -> None:
        """Begin, unless the settings leave the background work alone."""
        if self._ctx.settings.updater:
            self._worker.start()

    def request_stop(self) -> None:
        """Leave the round at hand; nothing of it is stored."""
        self._worker.request_stop()

    def stop(self) -> None:
        """End."""
        self.request_stop()
        self._worker.join()

    def alive(self) -> bool:
        """Whether it is at work, or has none."""
        return self._worker.alive() or not self._ctx.settings.updater

"""What is new at which location, from the bus, in handy portions."""

import threading
import time
from collections.abc import Callable, Mapping

from tidemap.events.bus import Bus
from tidemap.events.subscription import EventFilter, Subscription

_QUIET_S = 0.3
Fresh = Mapping[str, frozenset[str]]
"""By location: the kinds of its messages."""


class News:
    """Follows the bus and reports which locations have something new, at most a few times a second."""

    def __init__(self, report: Callable[[Fresh], None]) -> None:
        self._report = report
        self._woken = threading.Event()
        self._stopped = False

    def start(self, bus: Bus) -> None:
        """Follow from now on."""
        subscription = Subscription(bus, EventFilter(), self._woken.set)
        threading.Thread(target=self._work, args=(subscription,), name="viewer-news", daemon=True).start()

    def stop(self) -> None:
        """Follow no more."""
        self._stopped = True
        self._woken.set()

    def _work(self, subscription: Subscription) -> None:
        with subscription:
            while self._woken.wait() and not self._stopped:
                self._woken.clear()
                fresh: dict[str, frozenset[str]] = {}
                for message in iter(subscription.take, None):
                    fresh = together(fresh, {message.location: frozenset({message.kind})})
                if fresh:
                    self._report(fresh)
                    time.sleep(_QUIET_S)


def together(one: Fresh, other: Fresh) -> dict[str, frozenset[str]]:
    """The kinds of both, by location.

    >>> together({"lab": frozenset({"job"})}, {"lab": frozenset({"update"})}) == {"lab": {"job", "update"}}
    True
    """
    return {name: one.get(name, frozenset()) | other.get(name, frozenset()) for name in (*one, *other)}

"""The bus: messages to all listeners of this process."""

import logging
from collections.abc import Callable
from threading import Lock

from tidemap.events.messages import EventMessage

log = logging.getLogger(__name__)
Listener = Callable[[EventMessage], object]


class Bus:
    """Listeners are called in the thread that delivers, so they only take note and return.

    What this process publishes is delivered at once, unless it is redirected: several processes on one database
    deliver what any of them published.
    """

    def __init__(self) -> None:
        self._everyones = _Listeners()
        self._own = _Listeners()
        self._outlet: Listener = self.deliver

    def subscribe(self, listener: Listener) -> Callable[[], None]:
        """Call `listener` with every message from now on; returns what ends that."""
        return self._everyones.add(listener)

    def subscribe_own(self, listener: Listener) -> Callable[[], None]:
        """Call `listener` with every message of this process alone, as it is published; returns what ends that."""
        return self._own.add(listener)

    def publish(self, message: EventMessage) -> None:
        """Something has happened in this process."""
        self._own.call(message)
        self._outlet(message)

    def deliver(self, message: EventMessage) -> None:
        """Hand a message to every listener; one that fails does not keep it from the others."""
        self._everyones.call(message)

    def redirect(self, outlet: Listener) -> Callable[[], None]:
        """Hand what is published to `outlet`, which has it delivered; returns what ends that."""
        self._outlet = outlet

        def restore() -> None:
            self._outlet = self.deliver

        return restore


class _Listeners:
    """Those of one kind. May be shared by threads."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._all: tuple[Listener, ...] = ()

    def add(self, listener: Listener) -> Callable[[], None]:
        with self._lock:
            self._all = (*self._all, listener)

        def remove() -> None:
            with self._lock:
                self._all = tuple(each for each in self._all if each is not listener)

        return remove

    def call(self, message: EventMessage) -> None:
        for listener in self._all:
            try:
                listener(message)
            except Exception:
                log.exception("a listener failed on %s", message)

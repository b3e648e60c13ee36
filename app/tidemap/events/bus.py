"""The bus: messages to all listeners of this process."""

import logging
from collections.abc import Callable
from threading import Lock

from tidemap.events.messages import EventMessage

log = logging.getLogger(__name__)
Listener = Callable[[EventMessage], object]


class Bus:
    """Listeners are called in the publisher's thread, so they only take note and return."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._listeners: tuple[Listener, ...] = ()

    def subscribe(self, listener: Listener) -> Callable[[], None]:
        """Call `listener` with every message from now on; returns what ends that."""
        with self._lock:
            self._listeners = (*self._listeners, listener)

        def unsubscribe() -> None:
            with self._lock:
                self._listeners = tuple(each for each in self._listeners if each is not listener)

        return unsubscribe

    def publish(self, message: EventMessage) -> None:
        """Publish to every listener; one that fails does not keep it from the others."""
        for listener in self._listeners:
            try:
                listener(message)
            except Exception:
                log.exception("a listener failed on %s", message)

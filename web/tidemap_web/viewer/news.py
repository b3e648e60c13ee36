"""What is new at which location, from the bus, in handy portions."""

import threading
import time
from collections.abc import Callable

from tidemap.events.bus import Bus
from tidemap.events.messages import EventMessage

_QUIET_S = 0.3


class News:
    """Listens to the bus and reports which locations have something new, at most a few times a second."""

    def __init__(self, report: Callable[[set[str]], None]) -> None:
        self._report = report
        self._heard = threading.Condition()
        self._names: set[str] = set()
        self._stopped = False

    def start(self, bus: Bus) -> None:
        """Listen from now on."""
        unsubscribe = bus.subscribe(self._note)
        threading.Thread(target=self._work, args=(unsubscribe,), name="viewer-news", daemon=True).start()

    def stop(self) -> None:
        """Listen no more."""
        with self._heard:
            self._stopped = True
            self._heard.notify_all()

    def _note(self, message: EventMessage) -> None:
        with self._heard:
            self._names.add(message.location)
            self._heard.notify_all()

    def _work(self, unsubscribe: Callable[[], None]) -> None:
        while True:
            with self._heard:
                self._heard.wait_for(lambda: self._names or self._stopped)
                if self._stopped:
                    break
                names, self._names = self._names, set()
            self._report(names)
            time.sleep(_QUIET_S)
        unsubscribe()

"""A worker: one thread that does a round of something now and then, and that no error ends."""

import logging
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from threading import Event, Thread

from tidemap.errors import BusyError, DomainError, ShuttingDownError
from tidemap.storage.records import LocationRecord

log = logging.getLogger(__name__)


class Worker:
    """Calls `round_` every `interval_s` seconds, and when it is woken, until it is told to end."""

    def __init__(self, name: str, interval_s: float, round_: Callable[[], None]) -> None:
        self._name = name
        self._interval_s = interval_s
        self._round = round_
        self._wake = Event()
        self._stopping = Event()
        self._thread = Thread(target=self._loop, name=f"tidemap-{name}", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def wake(self) -> None:
        """Begin a round now, or another one after this."""
        self._wake.set()

    def check(self) -> None:
        """Raises ShuttingDownError where it is to end: a round calls this all the time, and leaves it to the loop."""
        if self._stopping.is_set():
            raise ShuttingDownError

    def check_with(self, other: Callable[[], None]) -> Callable[[], None]:
        """This check and another, as one."""

        def check() -> None:
            self.check()
            other()

        return check

    def request_stop(self) -> None:
        """Ends at the next `check`."""
        self._stopping.set()
        self._wake.set()

    def join(self, at_most_s: float | None = None) -> bool:
        """Wait until it has ended, or for so long; whether it has. The process ends without one that has not."""
        if self._thread.is_alive():
            self._thread.join(at_most_s)
        return not self._thread.is_alive()

    @contextmanager
    def running(self) -> Iterator[None]:
        """Begin, and in the end wait until it has ended."""
        self.start()
        try:
            yield
        finally:
            self.request_stop()
            self.join()

    def alive(self) -> bool:
        """Whether it is at work."""
        return self._thread.is_alive()

    def for_each(self, locations: Iterable[LocationRecord], care: Callable[[LocationRecord], None]) -> None:
        """Care for locations one after the other; one that cannot be cared for keeps no other from it."""
        for location in locations:
            self.check()
            try:
                care(location)
            except BusyError:
                raise
            except DomainError as error:
                log.warning("location %s: %s", location.name, error)
            except Exception:
                log.exception("location %s: its care failed", location.name)

    def _loop(self) -> None:
        while not self._stopping.is_set():
            try:
                self._round()
            except ShuttingDownError:
                return
            except BusyError as error:
                log.debug("the %s waits: %s", self._name, error.title)
            except Exception:
                log.exception("the %s failed and goes on", self._name)
            self._wake.wait(self._interval_s)
            self._wake.clear()

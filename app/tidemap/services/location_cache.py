"""Location cache: the locations that were posted to lately, so that a post need not read before it is stored."""

import time
from collections.abc import Callable
from threading import Lock

from cachetools import LRUCache

from tidemap.storage.records import LocationRecord

BELIEVED_S = 1.0
"""How long a record is taken for true; what this process changes is noticed at once."""
MAX_LOCATIONS = 10_000


class LocationCache:
    """Records by name, whose settings and revision are as they were a moment ago; their counters may be older.

    May be shared by threads.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic, most: int = MAX_LOCATIONS) -> None:
        self._clock = clock
        self._lock = Lock()
        self._known: LRUCache[str, tuple[float, LocationRecord]] = LRUCache(most)
        self._changes = 0

    def get(self, name: str, read: Callable[[str], LocationRecord]) -> LocationRecord:
        """The record of a name, as it is known or else as `read` has it, which raises where there is none."""
        with self._lock:
            until, record = self._known.get(name, (0.0, None))
            changes = self._changes
        if record is not None and self._clock() < until:
            return record
        record = read(name)
        with self._lock:
            # What was read before a change is out of date, and not kept.
            if changes == self._changes:
                self._known[name] = (self._clock() + BELIEVED_S, record)
        return record

    def lately(self, name: str) -> LocationRecord | None:
        """The record of a name as it was when it was last read, which may be long ago."""
        with self._lock:
            _, record = self._known.get(name, (0.0, None))
        return record

    def forget(self) -> None:
        """Something about locations has changed."""
        with self._lock:
            self._known.clear()
            self._changes += 1

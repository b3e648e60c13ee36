"""Damage: which stored blobs were found corrupt. Each is logged once and counted until its location is whole again."""

import logging
from threading import Lock

from tidemap.errors import CorruptChunkError

log = logging.getLogger(__name__)


class Damage:
    """What is known to be damaged, by location id."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._known: dict[int, set[str]] = {}

    def found(self, location_id: int, error: CorruptChunkError) -> None:
        """A blob of a location could not be read; the log says so the first time."""
        with self._lock:
            known = self._known.setdefault(location_id, set())
            new = error.what not in known
            known.add(error.what)
        if new:
            log.error("%s", error)

    def forget(self, location_id: int) -> None:
        """The location is whole, or gone."""
        with self._lock:
            self._known.pop(location_id, None)

    def count(self) -> int:
        """How many blobs are known to be damaged."""
        with self._lock:
            return sum(len(known) for known in self._known.values())

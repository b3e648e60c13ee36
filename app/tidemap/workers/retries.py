"""Retries: what fails for a location is tried again ever more rarely, and at once after it has worked."""

from collections.abc import Callable, Iterator

from tidemap.backoff import doubling

MAX_RETRY_S = 3600.0


class Retries:
    """By location id. Each failure in a row doubles how long it rests, from `first_s` seconds to an hour."""

    def __init__(self, first_s: float, clock: Callable[[], float]) -> None:
        self._first_s = first_s
        self._clock = clock
        self._pauses: dict[int, Iterator[float]] = {}
        self._due: dict[int, float] = {}

    def due(self, location_id: int) -> bool:
        """Whether to try it: it works, as far as is known, or has rested."""
        return not self.fails(location_id) or self._clock() >= self._due[location_id]

    def fails(self, location_id: int) -> bool:
        """Whether it failed when it was last tried."""
        return location_id in self._pauses

    def failed(self, location_id: int) -> None:
        """It was tried, and failed."""
        pauses = self._pauses.setdefault(location_id, doubling(self._first_s, MAX_RETRY_S))
        self._due[location_id] = self._clock() + next(pauses)

    def worked(self, location_id: int) -> None:
        """It was tried, and worked."""
        self._pauses.pop(location_id, None)

"""Retries: what fails for a location is tried again ever more rarely, and at once after it has worked."""

from collections.abc import Callable

MAX_RETRY_S = 3600.0


class Retries:
    """By location id. After n failures in a row it rests for `first_s` 2^(n - 1) seconds, an hour at most."""

    def __init__(self, first_s: float, clock: Callable[[], float]) -> None:
        self._first_s = first_s
        self._clock = clock
        self._failures: dict[int, int] = {}
        self._due: dict[int, float] = {}

    def due(self, location_id: int) -> bool:
        """Whether to try it: it works, as far as is known, or has rested."""
        return not self.fails(location_id) or self._clock() >= self._due[location_id]

    def fails(self, location_id: int) -> bool:
        """Whether it failed when it was last tried."""
        return location_id in self._failures

    def failed(self, location_id: int) -> None:
        """It was tried, and failed."""
        failures = self._failures[location_id] = self._failures.get(location_id, 0) + 1
        self._due[location_id] = self._clock() + min(MAX_RETRY_S, self._first_s * 2 ** min(failures - 1, 32))

    def worked(self, location_id: int) -> None:
        """It was tried, and worked."""
        self._failures.pop(location_id, None)

"""How long nothing is sent after a failure."""

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from tidemap.client.retry import RetryPolicy

MAX_ASKED_S = 900.0
"""A server that asks for a longer pause (Retry-After) is asked again after this one."""
ALL = ""


@dataclass
class Pause:
    """A pause until `until`; the server has asked for the part until `asked` (both of the clock)."""

    pauses: Iterator[float]
    until: float = -math.inf
    asked: float = -math.inf


class Backoff:
    """Pauses of locations, by path, and of everything, which double from failure to failure."""

    def __init__(self, retry: RetryPolicy, clock: Callable[[], float] = time.monotonic) -> None:
        self._retry = retry
        self._clock = clock
        self._backoff: dict[str, Pause] = {}

    def failed(self, path: str, asked_s: float | None) -> None:
        """Nothing is sent to the location at `path` (ALL: to any) for a pause, or as long as the server asked."""
        pause = self._backoff.setdefault(path, Pause(self._retry.pauses()))
        pause.asked = self._clock() + min(asked_s or 0.0, MAX_ASKED_S)
        pause.until = max(self._clock() + next(pause.pauses), pause.asked)

    def answered(self, path: str) -> None:
        """The server has decided on a batch of the location at `path`: no pause is left."""
        self._backoff.pop(path, None)
        self._backoff.pop(ALL, None)

    def hurry(self) -> None:
        """Cut pauses to what the server has asked for."""
        for pause in self._backoff.values():
            pause.until = pause.asked

    def left_s(self) -> float:
        """Seconds until anything may be sent; 0 or less: now."""
        return self._backoff[ALL].until - self._clock() if ALL in self._backoff else 0.0

    def paths(self) -> list[str]:
        """The locations that nothing is sent to now."""
        now = self._clock()
        return [path for path, pause in self._backoff.items() if path != ALL and pause.until > now]

    def next_s(self) -> float:
        """Seconds until the first of these locations may be sent to; infinite if there is none."""
        return min((self._backoff[path].until for path in self.paths()), default=math.inf) - self._clock()

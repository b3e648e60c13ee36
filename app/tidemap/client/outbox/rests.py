"""How long nothing is sent after a failure."""

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from tidemap.client.patience import Patience

LONGEST_ASKED_S = 900.0
"""A server that asks for a longer pause (Retry-After) is asked again after this one."""
ALL = ""


@dataclass
class Rest:
    """A pause until `until`, of which the server has asked for the part until `asked` (both of the clock)."""

    pauses: Iterator[float]
    until: float = -math.inf
    asked: float = -math.inf


class Rests:
    """Pauses of locations, by path, and of everything, which double from failure to failure."""

    def __init__(self, patience: Patience, clock: Callable[[], float] = time.monotonic) -> None:
        self._patience = patience
        self._clock = clock
        self._rests: dict[str, Rest] = {}

    def failed(self, path: str, asked_s: float | None) -> None:
        """Nothing is sent to the location at `path` (ALL: to any) for a pause, or as long as the server asked."""
        rest = self._rests.setdefault(path, Rest(self._patience.pauses()))
        rest.asked = self._clock() + min(asked_s or 0.0, LONGEST_ASKED_S)
        rest.until = max(self._clock() + next(rest.pauses), rest.asked)

    def answered(self, path: str) -> None:
        """The server has decided on a batch of the location at `path`: no pause is left."""
        self._rests.pop(path, None)
        self._rests.pop(ALL, None)

    def hurry(self) -> None:
        """Cut pauses to what the server has asked for."""
        for rest in self._rests.values():
            rest.until = rest.asked

    def left_s(self) -> float:
        """Seconds until anything may be sent; 0 or less: now."""
        return self._rests[ALL].until - self._clock() if ALL in self._rests else 0.0

    def paths(self) -> list[str]:
        """The locations that nothing is sent to now."""
        now = self._clock()
        return [path for path, rest in self._rests.items() if path != ALL and rest.until > now]

    def next_s(self) -> float:
        """Seconds until the first of these locations may be sent to; infinite if there is none."""
        return min((self._rests[path].until for path in self.paths()), default=math.inf) - self._clock()

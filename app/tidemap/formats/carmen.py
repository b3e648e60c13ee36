"""CARMEN logs: lines of text with the ranges of a laser and its pose."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import UnreadableBodyError

LASERS = {"FLASER", "RLASER"}
"""Front and rear; both count their angles from -90°."""
MAX_RANGES = 10_000
"""Of one line."""
MAX_LINE_BYTES = 1 << 20
NO_ECHO_M = 80.0
"""From here on the numbers of these lasers are codes of errors."""


@dataclass(frozen=True, slots=True, eq=False)
class LaserLine:
    """ranges (n,) metres, NaN without an echo; pose of the laser x, y (metres), theta; time in the log's seconds."""

    time: float
    pose: tuple[float, float, float]
    ranges: NDArray[np.float64]

    @property
    def angle(self) -> NDArray[np.float64]:
        """The angle of each range, (n,): from -90° on, by 180 or 181 (360 or 361) ranges a half circle."""
        n = len(self.ranges)
        return -np.pi / 2 + np.arange(n) * np.pi / max(n - n % 2, 1)


def read(lines: Iterable[bytes]) -> Iterator[LaserLine]:
    """The lines with ranges; others, such as ODOM and PARAM, are left out. Raises UnreadableBodyError."""
    for number, line in enumerate(lines, 1):
        if len(line) > MAX_LINE_BYTES:
            raise _unreadable(number, f"it has more than {MAX_LINE_BYTES} bytes")
        words = line.split()
        if words and words[0].decode("latin-1") in LASERS:
            yield _laser(number, words[1:])


def _laser(number: int, words: list[bytes]) -> LaserLine:
    n = int(words[0]) if words and words[0].isdigit() and len(words[0]) < 7 else 0
    if not 1 <= n <= MAX_RANGES:
        raise _unreadable(number, f"its number of ranges is none from 1 to {MAX_RANGES}")
    # Behind the ranges: the laser's pose, the odometry's, a time, a host, and the time in the log.
    if len(words) != n + 10:
        raise _unreadable(number, f"it has {len(words)} words, but one with {n} ranges has {n + 10}")
    try:
        ranges = np.array(words[1 : n + 1], np.float64)
        x, y, theta, time = (float(words[at]) for at in (n + 1, n + 2, n + 3, n + 7))
    except ValueError:
        raise _unreadable(number, "it has words where numbers belong") from None
    if not np.isfinite([x, y, theta, time]).all():
        raise _unreadable(number, "its pose or time is NaN or infinite")
    return LaserLine(time, (x, y, theta), np.where(ranges >= NO_ECHO_M, np.nan, ranges))


def _unreadable(number: int, why: str) -> UnreadableBodyError:
    return UnreadableBodyError(f"This CARMEN log cannot be read: line {number}: {why}. Leave the line out.")

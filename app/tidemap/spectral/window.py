"""The window a spectrum is fitted to."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tidemap.history.timebase import TimeBase
from tidemap.spectral.civil import DAY_S, DAYS_A_WEEK, WEEK_S

PAUSE_S: Final = WEEK_S
"""Shorter pauses are part of a rhythm."""


def chosen_window(
    base: TimeBase, known: tuple[int, int], own: tuple[int, int], times: tuple[float | None, float | None]
) -> tuple[int, int]:
    """The samples from one time to another, as far as they are known; for a time that is None the end of `own`."""
    first, last = base.clamp(known, *times)
    return own[0] if times[0] is None else first, own[1] if times[1] is None else last


def fft_window(seen: NDArray[np.int64], start: int, stop: int, interval_s: float) -> tuple[int, int]:
    """The part of samples [start, stop) that `fft` is fitted to; seen (n,): those that were observed, ascending."""
    return fit_window(*without_pauses(seen, start, stop, interval_s), interval_s)


def fit_window(start: int, stop: int, interval_s: float) -> tuple[int, int]:
    """The last whole weeks of samples [start, stop) if two or more, else the last whole days, else all.

    So the frequency of a day, or of a week, falls on a bin of the transform; between bins a
    forecast drifts out of phase. Where a day is no whole number of samples the nearest is taken.

    >>> fit_window(0, 10 * 1440 + 7, 60.0)
    (7, 14407)
    >>> fit_window(0, 100, 60.0)
    (0, 100)
    """
    days = math.floor((stop - start) * interval_s / DAY_S + 1e-9)
    if days >= 2 * DAYS_A_WEEK:
        days -= days % DAYS_A_WEEK
    if days < 1:
        return start, stop
    return max(start, stop - round(days * DAY_S / interval_s)), stop


def without_pauses(seen: NDArray[np.int64], start: int, stop: int, interval_s: float) -> tuple[int, int]:
    """The part of samples [start, stop) that no pause takes up most of.

    While a pause is longer than PAUSE_S and than half of the part, the side of it on which less was observed is left
    out. A transform that is mostly mask has its peaks smeared over many bins.

    >>> without_pauses(np.r_[0:40, 400], 0, 401, 86_400.0)
    (0, 40)
    >>> without_pauses(np.arange(0, 400, 10), 0, 400, 86_400.0)
    (0, 400)
    """
    while True:
        edge = np.concatenate(([start - 1], seen, [stop]))
        longest = int(np.argmax(np.diff(edge)))
        pause = int(edge[longest + 1] - edge[longest]) - 1
        if pause * interval_s <= PAUSE_S or 2 * pause <= stop - start or not seen.size:
            return start, stop
        if 2 * longest > seen.size:
            seen, stop = seen[:longest], int(edge[longest]) + 1
        else:
            seen, start = seen[longest:], int(edge[longest + 1])

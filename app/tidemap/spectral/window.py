"""The window a spectrum is fitted to."""

import math

DAY_S = 86_400.0
DAYS_A_WEEK = 7


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

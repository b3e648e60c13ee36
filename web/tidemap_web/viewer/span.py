"""The stretch of time that the timeline offers: the history and some of the future."""

from dataclasses import dataclass

DAY_S = 86400.0
WEEK_S = 7 * DAY_S


@dataclass(frozen=True, slots=True)
class Span:
    """Unix seconds: the history from `first` to `last`, and `stop`, the end of the offered future."""

    first: float
    last: float
    stop: float


def span(first: float, last: float, now: float) -> Span:
    """History plus a day, or a fifth of the history when that is more.

    The future counts from now when the map is kept up to date (last seen within a week), else from its end.

    >>> span(0.0, 864000.0, 1e9).stop / 86400
    12.0
    """
    edge = now if last < now <= last + WEEK_S else last
    return Span(first, last, edge + max(DAY_S, 0.2 * (last - first)))

"""Exponential back-off, shared by the client and the workers."""

from collections.abc import Iterator


def doubling(first_s: float, max_s: float) -> Iterator[float]:
    """Pauses in seconds, without end: `first_s`, then twice the one before, at most `max_s`.

    >>> from itertools import islice
    >>> list(islice(doubling(1.0, 5.0), 5))
    [1.0, 2.0, 4.0, 5.0, 5.0]
    """
    pause_s = min(first_s, max_s)
    while True:
        yield pause_s
        pause_s = min(2 * pause_s, max_s)

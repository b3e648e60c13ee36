"""The time base of a location: which sample a time falls into."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, slots=True)
class TimeBase:
    """Sample n covers [epoch + n interval_s, epoch + (n + 1) interval_s); Unix seconds, float64.

    What was measured in a sample stands for all of it, and what is predicted is predicted for all of it.

    >>> base = TimeBase(epoch=100.0, interval_s=60.0)
    >>> int(base.sample(99.9)), int(base.sample(100.0)), float(base.time(2))
    (-1, 0, 220.0)
    """

    epoch: float
    interval_s: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.epoch) and np.isfinite(self.interval_s) and self.interval_s > 0):
            raise ValueError(f"a time base needs a finite epoch and interval_s > 0, not {self}")

    def sample(self, time: ArrayLike) -> NDArray[np.int64]:
        """n = floor((time - epoch) / interval_s), int64, of the shape of `time`.

        The start of every sample, as `time` gives it, belongs to that sample: where the quotient
        was rounded down across it, it is put right.
        """
        seconds = np.asarray(time, np.float64)
        n = np.floor((seconds - self.epoch) / self.interval_s).astype(np.int64)
        n = n + (self.time(n + 1) <= seconds)
        return np.asarray(n - (self.time(n) > seconds), np.int64)

    def clamp(self, window: tuple[int, int], start: float | None, stop: float | None) -> tuple[int, int]:
        """The samples [first, last) of a window from the time `start` to `stop`, each by default its own end.

        Empty, or reversed, where the window has none of them.

        >>> TimeBase(0.0, 60.0).clamp((2, 9), 300.0, None)
        (5, 9)
        """
        first, last = window
        return (
            first if start is None else max(first, int(self.sample(start))),
            last if stop is None else min(last, int(self.sample(stop))),
        )

    def middle(self, sample: ArrayLike) -> NDArray[np.float64]:
        """The middle of a sample in seconds, epoch + (n + 1/2) interval_s; fractions of a sample allowed."""
        return self.time(np.asarray(sample, np.float64) + 0.5)

    def middle_of(self, time: ArrayLike) -> NDArray[np.float64]:
        """The middle of the sample that contains each time: where p of that whole sample is evaluated.

        >>> TimeBase(0.0, 60.0).middle_of([0.0, 59.9, 60.0]).tolist()
        [30.0, 30.0, 90.0]
        """
        return self.middle(self.sample(time))

    def time(self, sample: ArrayLike) -> NDArray[np.float64]:
        """The start of a sample in seconds, epoch + n interval_s; fractions of a sample allowed."""
        return np.asarray(self.epoch + np.asarray(sample, np.float64) * self.interval_s, np.float64)

"""Information: what looking at a cell is expected to say about its state (Lindley, 1956). In nats."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import entr

MAX_ENTROPY: Final = float(np.log(2))
"""Of a state that is free or occupied, in nats."""


@dataclass(frozen=True, slots=True)
class ErrorRates:
    """How often looks err. miss: P(seen free | occupied); false_alarm: P(seen occupied | free).

    ValueError unless both are in [0, 1] and their sum is less than 1: else a look says the contrary.
    """

    miss: float = 0.0
    false_alarm: float = 0.0

    def __post_init__(self) -> None:
        if not (0 <= self.miss <= 1 and 0 <= self.false_alarm <= 1 and self.miss + self.false_alarm < 1):
            raise ValueError(f"miss and false_alarm lie between 0 and 1, their sum below 1, not {self}")


EXACT: Final = ErrorRates()
"""A look that never errs."""


def entropy_nats(probability: ArrayLike) -> NDArray[np.float64]:
    """The entropy of the state, of the shape of p: 0 where certain, ln 2 at p = 0.5, NaN where p is.

    >>> entropy_nats([0.0, 0.5, 1.0]).round(4).tolist()
    [0.0, 0.6931, 0.0]
    """
    p = np.asarray(probability, np.float64)
    return np.minimum(entr(p) + entr(1 - p), MAX_ENTROPY)


def information(probability: ArrayLike, rates: ErrorRates = EXACT) -> NDArray[np.float64]:
    """The mutual information of the state and a look at it, of the shape of p; NaN where p is.

    The entropy of what will be seen, less the noise that is expected in it. Of looks that never err it is the entropy
    of the state.

    >>> information([0.0, 0.5, 1.0], ErrorRates(0.1, 0.1)).round(4).tolist()
    [0.0, 0.3681, 0.0]
    """
    p = np.asarray(probability, np.float64)
    if rates == EXACT:
        return entropy_nats(p)
    noise = p * entropy_nats(rates.miss) + (1 - p) * entropy_nats(rates.false_alarm)
    seen = p * (1 - rates.miss) + (1 - p) * rates.false_alarm
    return np.maximum(entropy_nats(seen) - noise, 0)


def best_times(time: NDArray[np.float64], value: NDArray[np.float64], n: int, apart_s: float) -> NDArray[np.int64]:
    """The rows of at most `n` times with the largest values, best first, any two at least `apart_s` apart.

    time, value (m,): the largest is taken, then the largest that is far enough from it, and so on; the earliest of
    equals.

    >>> best_times(np.arange(5.0), np.array([1.0, 3.0, 2.9, 0.0, 2.0]), 2, 2.0).tolist()
    [1, 4]
    """
    left = np.array(value, np.float64)
    chosen: list[int] = []
    while len(chosen) < n and np.isfinite(left).any():
        best = int(np.nanargmax(left))
        chosen.append(best)
        left[np.abs(time - time[best]) < apart_s] = -np.inf
        left[best] = -np.inf
    return np.array(chosen, np.int64)

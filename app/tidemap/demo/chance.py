"""Chance as a function of what it is about: the same key always draws the same number, in any order."""

import numpy as np
from numpy.typing import NDArray

_MASK = (1 << 64) - 1
_GOLDEN = 0x9E3779B97F4A7C15


def mix(*key: int) -> int:
    """64 well-mixed bits of a key (splitmix64).

    >>> mix(1, 2) == mix(1, 2), mix(1, 2) == mix(2, 1)
    (True, False)
    """
    bits = 0
    for part in key:
        bits = (bits + (part & _MASK) + _GOLDEN) & _MASK
        bits = ((bits ^ (bits >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
        bits = ((bits ^ (bits >> 27)) * 0x94D049BB133111EB) & _MASK
        bits ^= bits >> 31
    return bits


def draw(*key: int) -> float:
    """A number of [0, 1), uniform over keys."""
    return (mix(*key) >> 11) / (1 << 53)


def draws(items: NDArray[np.uint64], *key: int) -> NDArray[np.float64]:
    """Numbers of [0, 1) (n,), one for each item (n,) under the key; equal to `draw(*key, item)`."""
    bits = items + np.uint64((mix(*key) + _GOLDEN) & _MASK)
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    bits ^= bits >> np.uint64(31)
    return (bits >> np.uint64(11)) / float(1 << 53)

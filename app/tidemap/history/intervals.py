"""Intervals: run-length form of per-cell signals, compressed by rows."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tidemap.history import bits


@dataclass(frozen=True, slots=True, eq=False)
class Intervals:
    """Cell i has the runs offset[i]:offset[i + 1], half-open [start, stop) in samples, ascending.

    offset (n_cells + 1,) int64; start, stop (k,) int64; state (k,) uint8.
    """

    offset: NDArray[np.int64]
    start: NDArray[np.int64]
    stop: NDArray[np.int64]
    state: NDArray[np.uint8]

    @property
    def n_cells(self) -> int:
        return self.offset.size - 1

    @classmethod
    def empty(cls, n_cells: int) -> Self:
        none = np.zeros(0, np.int64)
        return cls(np.zeros(n_cells + 1, np.int64), none, none, np.zeros(0, np.uint8))


def set_positions(words: NDArray[np.uint64], first: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """offset (n_cells + 1,) and the samples of all set bits, `first` being the sample of bit 0."""
    offset = np.zeros(words.shape[0] + 1, np.int64)
    bits.count_words(words, offset[1:])
    np.cumsum(offset, out=offset)
    found = np.empty(int(offset[-1]), np.int64)
    bits.positions(words, first, found)
    return offset, found

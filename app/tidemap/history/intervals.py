"""Intervals: run-length form of per-cell signals, compressed by rows."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tidemap.history import bits


@dataclass(frozen=True, slots=True, eq=False)
class Runs:
    """Cell i has the runs offset[i]:offset[i + 1], half-open [start, stop) in samples, ascending.

    offset (n_cells + 1,), start (k,), stop (k,), all int64.
    """

    offset: NDArray[np.int64]
    start: NDArray[np.int64]
    stop: NDArray[np.int64]

    @property
    def n_cells(self) -> int:
        return self.offset.size - 1

    def of(self, cell: int) -> NDArray[np.int64]:
        """The runs of one cell, (n, 2). IndexError on a cell outside [0, n_cells)."""
        if not 0 <= cell < self.n_cells:
            raise IndexError(f"cell {cell} of {self.n_cells}")
        runs = slice(int(self.offset[cell]), int(self.offset[cell + 1]))
        return np.stack((self.start[runs], self.stop[runs]), axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Intervals(Runs):
    """Runs of constant state, (k,) uint8."""

    state: NDArray[np.uint8]

    @classmethod
    def empty(cls, n_cells: int) -> Self:
        none = np.zeros(0, np.int64)
        return cls(np.zeros(n_cells + 1, np.int64), none, none, np.zeros(0, np.uint8))


def offsets(
    count: Callable[[NDArray[np.uint64], NDArray[np.int64]], None], words: NDArray[np.uint64]
) -> NDArray[np.int64]:
    """Where each cell begins, (n_cells + 1,), among what `count` writes the number of per row of words."""
    offset = np.zeros(words.shape[0] + 1, np.int64)
    count(words, offset[1:])
    return np.cumsum(offset, out=offset)


def set_positions(words: NDArray[np.uint64], first: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """offset (n_cells + 1,) and the samples of all set bits, `first` being the sample of bit 0."""
    offset = offsets(bits.count_words, words)
    found = np.empty(int(offset[-1]), np.int64)
    bits.positions(words, first, found)
    return offset, found

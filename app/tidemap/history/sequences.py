"""Sequences: the readings of some cells one after the other, as a filter takes them."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tidemap.history.history import OCCUPIED, UNOBSERVED, History


@dataclass(frozen=True, slots=True, eq=False)
class Sequences:
    """The readings of n cells, those of cell i at offset[i]:offset[i + 1], their samples ascending.

    offset: (n + 1,) int64. sample: int64, state: uint8, one a reading.
    """

    offset: NDArray[np.int64]
    sample: NDArray[np.int64]
    state: NDArray[np.uint8]

    @property
    def n_cells(self) -> int:
        return len(self.offset) - 1

    @property
    def count(self) -> NDArray[np.int64]:
        """(n,) how many readings each cell has."""
        return np.diff(self.offset)

    @property
    def cell(self) -> NDArray[np.int64]:
        """The cell of every reading."""
        return np.repeat(np.arange(self.n_cells), self.count)

    @classmethod
    def of(cls, history: History) -> "Sequences":
        """All readings of a history.

        >>> found = Sequences.of(History.from_states(np.array([[2, 1, 0], [2, 2, 2], [1, 2, 2]], np.uint8), start=5))
        >>> found.offset.tolist(), found.sample.tolist(), found.state.tolist()
        ([0, 2, 2, 3], [6, 7, 5], [1, 0, 1])
        """
        states = history.states()
        cell, column = np.nonzero(states != UNOBSERVED)
        state = (states[cell, column] == OCCUPIED).astype(np.uint8)
        return cls(_offset(cell, history.n_cells), history.start + column, state)

    @classmethod
    def joined(cls, n_cells: int, parts: Iterable[tuple[NDArray[np.int64], "Sequences"]]) -> "Sequences":
        """Of `n_cells` cells, from parts in order of time, each with its cells."""
        empty = (np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0, np.uint8))
        found = [empty, *((rows[part.cell], part.sample, part.state) for rows, part in parts)]
        cell, sample, state = (np.concatenate(column) for column in zip(*found, strict=True))
        order = np.argsort(cell, kind="stable")
        return cls(_offset(cell, n_cells), sample[order], state[order])

    def select(self, chosen: NDArray[np.bool_]) -> "Sequences":
        """Some of the readings."""
        return Sequences(_offset(self.cell[chosen], self.n_cells), self.sample[chosen], self.state[chosen])

    def latest(self, most: int | NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which readings are among the latest of their cell, `most` of each, one number or (n,)."""
        left = np.repeat(self.offset[1:], self.count) - np.arange(len(self.sample))
        return np.asarray(left <= np.repeat(np.broadcast_to(most, self.n_cells), self.count))


def _offset(cell: NDArray[np.int64], n_cells: int) -> NDArray[np.int64]:
    return np.concatenate((np.zeros(1, np.int64), np.cumsum(np.bincount(cell, minlength=n_cells), dtype=np.int64)))

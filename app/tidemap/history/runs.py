"""Runs: since when each cell has been read in the state it was last read in."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tidemap.history.bits import ALL, Plane, Scalar, aligned_word, bit_at, highest
from tidemap.history.history import NEVER, UNOBSERVED, History
from tidemap.history.jit import kernel


@dataclass(frozen=True, slots=True, eq=False)
class LatestRuns:
    """The latest run of equal readings of some cells, (n,) each; unobserved samples do not end a run.

    state: uint8, UNOBSERVED where there is no reading. sample, begin: int64, the samples of the run's last and first
    reading, NEVER where there is none. whole: where the reading before the run was found, so that no older history
    changes it.
    """

    state: NDArray[np.uint8]
    sample: NDArray[np.int64]
    begin: NDArray[np.int64]
    whole: NDArray[np.bool_]

    @classmethod
    def none(cls, n_cells: int) -> "LatestRuns":
        """No readings yet."""
        return cls(
            np.full(n_cells, UNOBSERVED, np.uint8),
            np.full(n_cells, NEVER, np.int64),
            np.full(n_cells, NEVER, np.int64),
            np.zeros(n_cells, np.bool_),
        )

    def cells(self, cells: ArrayLike) -> "LatestRuns":
        """These cells only, in the given order; a copy."""
        rows = np.asarray(cells, np.int64)
        return LatestRuns(self.state[rows], self.sample[rows], self.begin[rows], self.whole[rows])

    def put(self, cells: ArrayLike, runs: "LatestRuns") -> None:
        """In place: the runs of these cells."""
        rows = np.asarray(cells, np.int64)
        for mine, new in zip(self._columns(), runs._columns(), strict=True):
            mine[rows] = new

    def _columns(self) -> tuple[NDArray[np.generic], ...]:
        return self.state, self.sample, self.begin, self.whole

    def extend(self, earlier: History, sample: int) -> None:
        """In place: follow the runs back through history at or before `sample`, older than all that was read so far."""
        last = min(int(sample), earlier.stop - 1) - earlier.start
        if last >= 0:
            planes = (earlier.observed, earlier.occupied)
            _extend(*planes, earlier.start, last, self.state, self.sample, self.begin, self.whole)


@kernel
def _extend(
    observed: Plane,
    occupied: Plane,
    start: int,
    last: int,
    state: NDArray[np.uint8],
    sample: NDArray[np.int64],
    begin: NDArray[np.int64],
    whole: NDArray[np.bool_],
) -> None:
    """In place, of every cell that is not whole: bits <= last, read backwards by words."""
    for cell in range(observed.shape[0]):
        word, mask = last >> 6, ALL >> np.uint64(63 - (last & 63))
        while word >= 0 and not whole[cell]:
            observed_bits = aligned_word(observed, cell, word) & mask
            if observed_bits != np.uint64(0):
                first = start + 64 * word
                if state[cell] == UNOBSERVED:
                    position = highest(observed_bits)
                    sample[cell] = first + position
                    state[cell] = bit_at(occupied, cell, 64 * word + position)
                occupied_bits = aligned_word(occupied, cell, word) & observed_bits
                other = observed_bits & ~occupied_bits if state[cell] else occupied_bits
                if other != np.uint64(0):
                    whole[cell] = True
                    observed_bits = _above(observed_bits, highest(other))
                if observed_bits != np.uint64(0):
                    begin[cell] = first + _lowest(observed_bits)
            mask = ALL
            word -= 1


@kernel
def _above(word: Scalar, position: int) -> Scalar:
    """The bits of a word above a position."""
    return word & ~(ALL >> np.uint64(63 - position))


@kernel
def _lowest(word: Scalar) -> int:
    """The position of the lowest set bit of a word that is not zero."""
    return highest(word & (~word + np.uint64(1)))

"""Film: what was last seen of every cell at any sample of a window, packed, so that moving in it searches nothing."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tidemap.history.bits import ALL, WORD, highest
from tidemap.history.history import NEVER, UNOBSERVED, History
from tidemap.history.jit import kernel


@dataclass(slots=True, eq=False)
class Film:
    """Samples [start, start + 64 n_words) of n cells; `start` is a multiple of 64.

    state (n,) uint8 and sample (n,) int64: last seen before `start`, UNOBSERVED and NEVER where there is none.
    observed and occupied (n, n_words) uint64: the samples of the window, bit by bit.
    """

    start: int
    state: NDArray[np.uint8]
    sample: NDArray[np.int64]
    observed: NDArray[np.uint64]
    occupied: NDArray[np.uint64]

    @classmethod
    def blank(cls, n_cells: int, start: int, n_words: int) -> "Film":
        """Nothing seen yet. ValueError where `start` is no multiple of 64."""
        if start % WORD:
            raise ValueError(f"a film begins at a multiple of {WORD}, not at {start}")
        state, sample = np.full(n_cells, UNOBSERVED, np.uint8), np.full(n_cells, NEVER, np.int64)
        return cls(start, state, sample, *(np.zeros((n_cells, n_words), np.uint64) for _ in range(2)))

    @property
    def stop(self) -> int:
        """The sample after the last."""
        return self.start + WORD * int(self.observed.shape[1])

    @property
    def nbytes(self) -> int:
        """The memory it takes."""
        return sum(each.nbytes for each in (self.state, self.sample, self.observed, self.occupied))

    def lay(self, first: int, piece: History) -> None:
        """In place: what a piece of history says of the cells from `first` on; pieces come latest first."""
        rows = slice(first, first + piece.n_cells)
        within = piece.window(self.start, self.stop)
        self.observed[rows] |= np.ascontiguousarray(within.observed).view(np.uint64)
        self.occupied[rows] |= np.ascontiguousarray(within.occupied).view(np.uint64)
        state, sample = piece.last_seen(self.start - 1)
        older = self.sample[rows] == NEVER
        self.state[rows] = np.where(older, state, self.state[rows])
        self.sample[rows] = np.where(older, sample, self.sample[rows])

    def clear(self, first: int, n_cells: int) -> None:
        """In place: forget what was seen of some cells."""
        rows = slice(first, first + n_cells)
        self.state[rows], self.sample[rows] = UNOBSERVED, NEVER
        self.observed[rows] = self.occupied[rows] = 0

    def put(self, cell: NDArray[np.uint32], sample: NDArray[np.int64], state: NDArray[np.uint8]) -> None:
        """In place: readings (m,) in [start, stop), in order; of several of a cell in a sample the latest stands."""
        _put(self.observed, self.occupied, cell, sample - self.start, state)

    def holds(self, cell: NDArray[np.uint32], sample: NDArray[np.int64]) -> NDArray[np.bool_]:
        """(m,) whether the cells were observed in these samples of the window."""
        bit = sample - self.start
        return np.asarray(self.observed[cell, bit >> 6] >> (bit & 63).astype(np.uint64) & np.uint64(1), np.bool_)

    def wind(self, start: int) -> None:
        """In place: let the window begin later, at a multiple of 64; what is before it is what was last seen."""
        words = min((start - self.start) // WORD, int(self.observed.shape[1]))
        state, sample = self.at(self.start + WORD * words - 1)
        self.state[:], self.sample[:] = state, sample
        for plane in (self.observed, self.occupied):
            plane[:, : plane.shape[1] - words] = plane[:, words:].copy()
            plane[:, plane.shape[1] - words :] = 0
        self.start = start

    def at(self, sample: int) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
        """State and sample (n,) as last seen at or before a sample, which is `start` - 1 or later. 5 ns a cell."""
        state, seen = self.state.copy(), self.sample.copy()
        last = min(sample, self.stop - 1) - self.start
        if last >= 0:
            _at(self.observed, self.occupied, self.start, last, state, seen)
        return state, seen

    def of(self, cell: NDArray[np.integer]) -> "Film":
        """That of some cells (m,)."""
        planes = (self.state, self.sample, self.observed, self.occupied)
        return Film(self.start, *(each[cell] for each in planes))


def window_start(sample: int, n_words: int) -> int:
    """Where the window of `n_words` words that holds a sample begins: windows lie side by side.

    >>> window_start(300, 2), window_start(-1, 2)
    (256, -128)
    """
    return sample // (WORD * n_words) * (WORD * n_words)


@kernel
def _put(
    observed: NDArray[np.uint64],
    occupied: NDArray[np.uint64],
    cell: NDArray[np.uint32],
    bit: NDArray[np.int64],
    state: NDArray[np.uint8],
) -> None:
    """Set the bits of readings, one after the other."""
    for i in range(cell.size):
        word, mask = bit[i] >> 6, np.uint64(1) << np.uint64(bit[i] & 63)
        observed[cell[i], word] |= mask
        if state[i]:
            occupied[cell[i], word] |= mask
        else:
            occupied[cell[i], word] &= ~mask


@kernel
def _at(
    observed: NDArray[np.uint64],
    occupied: NDArray[np.uint64],
    start: int,
    last: int,
    state: NDArray[np.uint8],
    sample: NDArray[np.int64],
) -> None:
    """Per cell the highest observed bit <= last as `start` + bit, and its state; untouched where none."""
    for cell in range(observed.shape[0]):
        word = last >> 6
        value = observed[cell, word] & (ALL >> np.uint64(63 - (last & 63)))
        while value == np.uint64(0) and word > 0:
            word -= 1
            value = observed[cell, word]
        if value != np.uint64(0):
            bit = highest(value)
            sample[cell] = start + 64 * word + bit
            state[cell] = np.uint8(occupied[cell, word] >> np.uint64(bit) & np.uint64(1))

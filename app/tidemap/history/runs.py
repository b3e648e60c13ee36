"""Runs: since when each cell has been read in the state it was last read in."""

from collections.abc import Iterator
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

    @property
    def known(self) -> NDArray[np.bool_]:
        """(n,) which cells were read."""
        return np.asarray(self.state != UNOBSERVED)

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

    def read_on(self, later: "LaterReadings", before: NDArray[np.int64]) -> NDArray[np.bool_]:
        """In place: go on with readings after all that was read so far; the last of a sample is the one that stands.

        before (n,): where the run has one sample only, the begin of the run before it, NEVER where that is not known;
        in place, too. (n,) the cells whose run is not known any more: the run before would go on. `whole` stays as it
        is, so no run can be followed back afterwards.
        """
        lost = np.zeros(len(self.state), np.bool_)
        for row, sample, state in later.steps():
            begin, read = self.begin[row], self.state[row] != UNOBSERVED
            same, again = self.state[row] == state, self.sample[row] == sample
            # All that there was of the run stands no longer.
            gone = again & ~same & (begin == sample)
            lost[row] |= gone & (before[row] == NEVER)
            self.begin[row] = np.where(gone, before[row], np.where(same, begin, sample))
            kept = np.where(same & again, before[row], NEVER)
            before[row] = np.where(read & ~same & ~gone, begin, kept)
            self.state[row], self.sample[row] = state, sample
        return lost

    def extend(self, earlier: History, sample: int) -> None:
        """In place: follow the runs back through history at or before `sample`, older than all that was read so far."""
        last = min(int(sample), earlier.stop - 1) - earlier.start
        if last >= 0:
            planes = (earlier.observed, earlier.occupied)
            _extend(*planes, earlier.start, last, self.state, self.sample, self.begin, self.whole)


@dataclass(frozen=True, slots=True, eq=False)
class RunsBefore:
    """Where the runs before the latest ones begin, (k,) each, of a few rows, ascending; of others it is not known."""

    row: NDArray[np.int64]
    begin: NDArray[np.int64]

    @property
    def nbytes(self) -> int:
        """The memory it takes."""
        return self.row.nbytes + self.begin.nbytes

    def of(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """(n,) of some rows, ascending; NEVER where it is not known."""
        found = np.full(len(rows), NEVER, np.int64)
        _, mine, held = np.intersect1d(rows, self.row, assume_unique=True, return_indices=True)
        found[mine] = self.begin[held]
        return found

    def replaced(self, rows: NDArray[np.int64], begin: NDArray[np.int64]) -> "RunsBefore":
        """That of some rows, ascending, replaced."""
        others, known = ~np.isin(self.row, rows, assume_unique=True), begin != NEVER
        row = np.concatenate((self.row[others], rows[known]))
        order = np.argsort(row)
        return RunsBefore(row[order], np.concatenate((self.begin[others], begin[known]))[order])


UNKNOWN_BEFORE = RunsBefore(np.zeros(0, np.int64), np.zeros(0, np.int64))


@dataclass(frozen=True, slots=True, eq=False)
class LaterReadings:
    """Which readings stand, (n,) each, ordered by row, then sample; no row has two in one sample."""

    row: NDArray[np.int64]
    sample: NDArray[np.int64]
    state: NDArray[np.uint8]

    @classmethod
    def latest(
        cls, row: NDArray[np.int64], sample: NDArray[np.int64], time: NDArray[np.float64], state: NDArray[np.uint8]
    ) -> "LaterReadings":
        """Of several measurements of a row in a sample the latest; of two at one time the occupied one.

        >>> found = LaterReadings.latest(np.array([7, 7, 7]), np.array([0, 0, 1]), np.arange(3.0), np.uint8([0, 1, 1]))
        >>> found.row.tolist(), found.sample.tolist(), found.state.tolist()
        ([7, 7], [0, 1], [1, 1])
        """
        order = np.lexsort((state, time, row))
        row, sample = row[order], sample[order]
        stands = np.ones(len(row), np.bool_)
        stands[:-1] = (row[1:] != row[:-1]) | (sample[1:] != sample[:-1])
        return cls(row[stands], sample[stands], state[order][stands])

    def steps(self) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.uint8]]]:
        """Rows, samples and states: the first reading of every row, then the second of those that have two, and on."""
        heads = np.flatnonzero(np.diff(self.row, prepend=-1))
        counts = np.diff(heads, append=len(self.row))
        for step in range(int(counts.max(initial=0))):
            at = heads[counts > step] + step
            yield self.row[at], self.sample[at], self.state[at]


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

"""History: what was observed, per cell and sample, as packed bit planes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tidemap.history import bits
from tidemap.history.intervals import Intervals, set_positions

FREE: Final = 0
OCCUPIED: Final = 1
UNOBSERVED: Final = 2
NEVER: Final = int(np.iinfo(np.int64).min)
NO_ENDS: Final = np.zeros((0, 0), np.uint8)

__all__ = ["FREE", "NEVER", "OCCUPIED", "UNOBSERVED", "History", "Intervals"]


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """s(t) of every cell over the samples [start, start + n_samples).

    observed, occupied: (n_cells, ceil(n_samples / 8)) uint8, bitorder "little"; occupied only where
    observed, bits past n_samples zero (`check` verifies both; the constructor only the shapes).
    ended: a plane of the samples with whose end a state is held no longer; None where there is none.
    """

    start: int
    n_samples: int
    observed: NDArray[np.uint8]
    occupied: NDArray[np.uint8]
    ended: NDArray[np.uint8] | None = None

    def __post_init__(self) -> None:
        for plane in (self.observed, self.occupied):
            if plane.dtype != np.uint8 or plane.ndim != 2 or not plane.flags.c_contiguous:
                raise ValueError("a plane is a C-contiguous (n_cells, n_bytes) array of uint8")
        expected = (self.observed.shape[0], bits.n_bytes(self.n_samples))
        if self.n_samples < 0 or self.observed.shape != expected or self.occupied.shape != expected:
            raise ValueError(
                f"{self.n_samples} samples need planes of shape {expected}, "
                f"not {self.observed.shape} and {self.occupied.shape}"
            )

    @property
    def n_cells(self) -> int:
        return int(self.observed.shape[0])

    @property
    def stop(self) -> int:
        """One past the last sample."""
        return self.start + self.n_samples

    def check(self) -> Self:
        """Itself, or ValueError where the planes contradict each other; O(bytes), for stored data."""
        if np.any(self.occupied & ~self.observed):
            raise ValueError("occupied where nothing was observed")
        if self.n_samples % 8 and np.any(self.observed[:, -1] >> (self.n_samples % 8)):
            raise ValueError("observed after the last sample")
        return self

    @classmethod
    def empty(cls, n_cells: int, start: int = 0, n_samples: int = 0) -> Self:
        """Nothing observed yet."""
        shape = (n_cells, bits.n_bytes(n_samples))
        return cls(int(start), int(n_samples), np.zeros(shape, np.uint8), np.zeros(shape, np.uint8))

    @classmethod
    def from_states(cls, states: NDArray[np.uint8], start: int = 0) -> Self:
        """From dense (n_cells, n_samples) states; ValueError on any other than the three.

        >>> History.from_states(np.array([[0, 1, 2]], np.uint8)).states()
        array([[0, 1, 2]], dtype=uint8)
        """
        states = np.asarray(states)
        if states.ndim != 2 or np.any(states > UNOBSERVED) or np.any(states < FREE):
            raise ValueError("states are (n_cells, n_samples) of 0 free, 1 occupied, 2 unobserved")
        observed = np.packbits(states != UNOBSERVED, axis=1, bitorder="little")
        occupied = np.packbits(states == OCCUPIED, axis=1, bitorder="little")
        return cls(int(start), int(states.shape[1]), observed, occupied)

    @classmethod
    def from_measurements(
        cls, n_cells: int, start: int, stop: int, cell: ArrayLike, sample: ArrayLike, state: ArrayLike
    ) -> Self:
        """From lists of measurements in order of time: of several of one cell in one sample the last
        stands. ValueError where a cell, sample or state is out of range. O(measurements)."""
        cells, samples = np.asarray(cell, np.int64).ravel(), np.asarray(sample, np.int64).ravel()
        states = np.asarray(state).ravel()
        if not cells.size == samples.size == states.size:
            raise ValueError("cell, sample and state differ in length")
        if cells.size and (cells.min() < 0 or cells.max() >= n_cells):
            raise ValueError(f"a cell outside [0, {n_cells})")
        if samples.size and (samples.min() < start or samples.max() >= stop):
            raise ValueError(f"a sample outside [{start}, {stop})")
        if np.any((states != FREE) & (states != OCCUPIED)):
            raise ValueError("a state that is neither 0 nor 1")
        history = cls.empty(n_cells, start, stop - start)
        bits.put(history.observed, history.occupied, cells, samples - start, states.astype(np.uint8))
        return history

    def states(self) -> NDArray[np.uint8]:
        """Dense (n_cells, n_samples) uint8 of FREE, OCCUPIED and UNOBSERVED."""
        observed = self._dense(self.observed)
        return np.where(observed == 1, self._dense(self.occupied), np.uint8(UNOBSERVED))

    def _dense(self, plane: NDArray[np.uint8]) -> NDArray[np.uint8]:
        return np.unpackbits(plane, axis=1, count=self.n_samples, bitorder="little")

    def window(self, start: int, stop: int) -> "History":
        """The samples [start, stop); outside of what is held they are unobserved."""
        if stop < start:
            raise ValueError(f"a window ends before it starts: [{start}, {stop})")
        if (start, stop) == (self.start, self.stop):
            return self
        window = History.empty(self.n_cells, start, stop - start)
        bits.copy_window(self.observed, start - self.start, window.n_samples, window.observed)
        bits.copy_window(self.occupied, start - self.start, window.n_samples, window.occupied)
        if self.ended is None:
            return window
        ended = np.zeros_like(window.observed)
        bits.copy_window(self.ended, start - self.start, window.n_samples, ended)
        return replace(window, ended=ended)

    def ending(self, cell: NDArray[np.integer[Any]], sample: NDArray[np.int64]) -> "History":
        """The same, where a state of each cell is held no longer than to the end of the sample beside it, (k,) each."""
        ended = np.zeros_like(self.observed) if self.ended is None else self.ended.copy()
        bit = sample - self.start
        np.bitwise_or.at(ended, (cell, bit >> 3), np.uint8(1) << (bit & 7).astype(np.uint8))
        return replace(self, ended=ended)

    def ends(self, cell: int) -> NDArray[np.int64]:
        """The samples with whose end a state of a cell is held no longer, ascending."""
        if self.ended is None:
            return np.zeros(0, np.int64)
        return self.start + np.flatnonzero(np.unpackbits(self.ended[cell], count=self.n_samples, bitorder="little"))

    def cells(self, cells: ArrayLike) -> "History":
        """These cells only, in the given order."""
        rows = np.asarray(cells, np.int64)
        ended = None if self.ended is None else self.ended[rows]
        return History(self.start, self.n_samples, self.observed[rows], self.occupied[rows], ended)

    @classmethod
    def stack(cls, parts: "Sequence[History]") -> Self:
        """The cells of all parts, at least one, of the same samples."""
        planes = (np.concatenate([getattr(part, plane) for part in parts]) for plane in ("observed", "occupied"))
        return cls(parts[0].start, parts[0].n_samples, *planes)

    def overlay(self, newer: "History") -> "History":
        """Both over the hull of their windows; where both observed, `newer` stands."""
        start, stop = min(self.start, newer.start), max(self.stop, newer.stop)
        below, above = self.window(start, stop), newer.window(start, stop)
        occupied = (below.occupied & ~above.observed) | above.occupied
        return History(start, stop - start, below.observed | above.observed, occupied)

    def hold(self, hold_samples: int) -> "History":
        """A state stands until the next measurement or its `ended`, at most `hold_samples` samples after its own."""
        if hold_samples < 0:
            raise ValueError(f"hold_samples must not be negative: {hold_samples}")
        held = History(self.start, self.n_samples, self.observed.copy(), self.occupied.copy())
        ended = NO_ENDS if self.ended is None else self.ended
        bits.hold(held.observed, held.occupied, ended, self.n_samples, hold_samples)
        return held

    def held(self, start: int, stop: int, hold_samples: int) -> "History":
        """Samples [start, stop), a state held as by `hold`, past the end of what is known too."""
        return self.window(self.start, max(self.stop, stop)).hold(hold_samples).window(start, stop)

    def last_seen(self, sample: int) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
        """The latest observed state at or before `sample` and its sample, (n_cells,) each.

        UNOBSERVED and NEVER, the least int64, where there is none. Reads the planes backwards.
        """
        state = np.full(self.n_cells, UNOBSERVED, np.uint8)
        seen = np.full(self.n_cells, NEVER, np.int64)
        last = min(int(sample), self.stop - 1) - self.start
        if last >= 0:
            bits.last_seen(self.observed, self.occupied, self.start, last, state, seen)
        return state, seen

    def observed_at(self, cell: NDArray[np.int64], sample: NDArray[np.int64]) -> NDArray[np.bool_]:
        """(n,) whether each cell was observed in the sample beside it, which is one of those held."""
        bit = sample - self.start
        return np.asarray(self.observed[cell, bit >> 3] >> (bit & 7).astype(np.uint8) & 1, np.bool_)

    def series(self, cell: int, start: int, stop: int) -> NDArray[np.uint8]:
        """The states of one cell over [start, stop), (stop - start,) uint8."""
        if not 0 <= cell < self.n_cells:
            raise IndexError(f"cell {cell} of {self.n_cells}")
        one = History(self.start, self.n_samples, self.observed[cell : cell + 1], self.occupied[cell : cell + 1])
        return np.asarray(one.window(start, stop).states()[0], np.uint8)

    def seen(self) -> NDArray[np.int64]:
        """The samples in which any cell was observed, ascending."""
        if not self.n_cells:
            return np.zeros(0, np.int64)
        plane = np.bitwise_or.reduce(self.observed, axis=0)
        return self.start + np.flatnonzero(np.unpackbits(plane, count=self.n_samples, bitorder="little"))

    def ever_observed(self) -> NDArray[np.bool_]:
        """(n_cells,) whether any sample was observed."""
        found = np.zeros(self.n_cells, np.bool_)
        bits.any_ones(self.observed, found)
        return found

    def changing(self) -> NDArray[np.int64]:
        """The cells that were observed both occupied and free, ascending."""
        occupied = self.count_occupied()
        return np.flatnonzero((occupied > 0) & (occupied < self.count_observed()))

    def count_observed(self) -> NDArray[np.int64]:
        """(n_cells,) the observed samples."""
        return _count(self.observed)

    def count_occupied(self) -> NDArray[np.int64]:
        """(n_cells,) the occupied samples."""
        return _count(self.occupied)

    def intervals(self) -> Intervals:
        """Run-length form: per cell the runs of constant state, unobserved ones included."""
        if self.n_samples == 0:
            return Intervals.empty(self.n_cells)
        begins = np.zeros((self.n_cells, -(-self.n_samples // bits.WORD)), np.uint64)
        bits.boundaries(self.observed, self.occupied, self.n_samples, begins)
        offset, start = set_positions(begins, self.start)
        stop = np.empty_like(start)
        stop[:-1] = start[1:]
        stop[offset[1:] - 1] = self.stop
        state = self._state_at(np.repeat(np.arange(self.n_cells), np.diff(offset)), start - self.start)
        return Intervals(offset, start, stop, state)

    def _state_at(self, cell: NDArray[np.int64], bit: NDArray[np.int64]) -> NDArray[np.uint8]:
        mask = np.uint8(1) << (bit & 7).astype(np.uint8)
        observed = (self.observed[cell, bit >> 3] & mask) != 0
        occupied = (self.occupied[cell, bit >> 3] & mask) != 0
        return np.where(observed, occupied.astype(np.uint8), np.uint8(UNOBSERVED))

    @classmethod
    def from_intervals(cls, intervals: Intervals, start: int | None = None, stop: int | None = None) -> Self:
        """From runs; samples of no run are unobserved. The window is the hull of the runs unless given;
        ValueError where a run is outside of it."""
        if intervals.start.size:
            first, end = int(intervals.start.min()), int(intervals.stop.max())
        else:
            first = end = 0 if start is None else start
        start, stop = first if start is None else start, end if stop is None else stop
        if intervals.start.size and (first < start or end > stop):
            raise ValueError(f"a run outside [{start}, {stop})")
        history = cls.empty(intervals.n_cells, start, stop - start)
        runs = (start, intervals.offset, intervals.start, intervals.stop)
        bits.put_runs(history.observed, *runs, intervals.state != UNOBSERVED)
        bits.put_runs(history.occupied, *runs, intervals.state == OCCUPIED)
        return history


def _count(plane: NDArray[np.uint8]) -> NDArray[np.int64]:
    total = np.zeros(plane.shape[0], np.int64)
    bits.count_ones(plane, total)
    return total

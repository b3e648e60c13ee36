"""Measurements: when which cell was seen in which state."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from tidemap.history.timebase import TimeBase

Key = TypeVar("Key", np.uint32, np.uint64)
UNAVAILABLE: Final = 2
"""Of a measurement: its sensor says that it does not know the state from now on, which ends what is held."""
STATE_BITS = 2
FEW_RUNS = 64
"""Runs of ascending keys that are merged rather than sorted anew."""


@dataclass(frozen=True, eq=False)
class Measurements:
    """`time` (n,) float64 Unix seconds; `cell` (n,) uint32 linear index; `state` (n,) uint8: 1 occupied, 0 free,
    UNAVAILABLE.

    Where all are of one time, `time` may be that one, broadcast.
    """

    time: NDArray[np.float64]
    cell: NDArray[np.uint32]
    state: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.time)

    @property
    def nbytes(self) -> int:
        """The memory it takes; a time that is said once for all takes none."""
        return self.cell.nbytes + self.state.nbytes + (self.time.nbytes if self.time.strides[0] else 0)

    def select(self, rows: NDArray[np.generic] | slice) -> "Measurements":
        """The measurements of some rows (a mask, indices or a slice)."""
        return Measurements(self.time[rows], self.cell[rows], self.state[rows])

    @cached_property
    def heads(self) -> NDArray[np.int64]:
        """Where runs of equal times begin: many measurements are made at one time, and what follows is done once."""
        if len(self) and self.time.strides == (0,):
            return np.zeros(1, np.int64)
        changed = np.ones(len(self), np.bool_)
        np.not_equal(self.time[1:], self.time[:-1], out=changed[1:])
        return np.flatnonzero(changed)

    def in_order(self) -> "Measurements":
        """The same rows sorted by time, then cell, then state; O(n log n) on one column of integers."""
        heads = self.heads
        if len(heads) == 1 and self.cell.max() < 1 << 32 - STATE_BITS:
            pair = _sorted(self.cell << np.uint32(STATE_BITS) | self.state)
            return Measurements(self.time, pair >> np.uint32(STATE_BITS), (pair & np.uint32(3)).astype(np.uint8))
        table, first = self.time[heads], np.arange(len(heads))
        if (np.diff(table) < 0).any():
            table, first = np.unique(table, return_inverse=True)
        rank = np.repeat(first.astype(np.uint64), np.diff(heads, append=len(self)))
        cells = self.cell.astype(np.uint64) << np.uint64(STATE_BITS)
        key = _sorted(rank << np.uint64(32 + STATE_BITS) | cells | self.state)
        cell = (key >> np.uint64(STATE_BITS)).astype(np.uint32)
        return Measurements(table[key >> np.uint64(32 + STATE_BITS)], cell, (key & np.uint64(3)).astype(np.uint8))

    def says(self) -> NDArray[np.bool_]:
        """(n,) which of them say what the state is: all but those that are UNAVAILABLE."""
        return np.asarray(self.state != UNAVAILABLE)

    def samples(self, base: TimeBase) -> NDArray[np.int64]:
        """The sample of each measurement."""
        heads = self.heads
        return np.repeat(base.sample(self.time[heads]), np.diff(heads, append=len(self)))

    @classmethod
    def concatenate(cls, parts: "list[Measurements]") -> "Measurements":
        """All parts, one after the other."""
        if not parts:
            return cls(np.empty(0), np.empty(0, np.uint32), np.empty(0, np.uint8))
        if len(parts) == 1:
            return parts[0]
        return cls(
            np.concatenate([part.time for part in parts]),
            np.concatenate([part.cell for part in parts]),
            np.concatenate([part.state for part in parts]),
        )


def _sorted(key: NDArray[Key]) -> NDArray[Key]:
    """The keys, sorted in place; O(n) where they are few ascending runs, as in snapshots sent state by state."""
    few = np.count_nonzero(key[1:] < key[:-1]) < FEW_RUNS
    key.sort(kind="stable" if few else "quicksort")
    return key

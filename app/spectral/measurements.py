"""Measurements: when which cell was seen in which state."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class Measurements:
    """`time` (n,) float64 Unix seconds; `cell` (n,) uint32 linear index; `state` (n,) uint8, 1 occupied, 0 free."""

    time: NDArray[np.float64]
    cell: NDArray[np.uint32]
    state: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.time)

    def select(self, rows: NDArray[np.generic] | slice) -> "Measurements":
        """The measurements of some rows (a mask, indices or a slice)."""
        return Measurements(self.time[rows], self.cell[rows], self.state[rows])

    @classmethod
    def concatenate(cls, parts: "list[Measurements]") -> "Measurements":
        """All parts, one after the other."""
        if not parts:
            return cls(np.empty(0), np.empty(0, np.uint32), np.empty(0, np.uint8))
        return cls(
            np.concatenate([part.time for part in parts]),
            np.concatenate([part.cell for part in parts]),
            np.concatenate([part.state for part in parts]),
        )

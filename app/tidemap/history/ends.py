"""Ends: when sensors said of cells that they are unavailable, which ends what was held of them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tidemap.history.timebase import TimeBase


@dataclass(frozen=True, slots=True, eq=False)
class Ends:
    """cell (k,) uint32; time (k,) float64 Unix seconds. In order of cell and time, the latest of each cell and sample.

    Canonical: the same statements are the same ends, in whatever order and parts they came.
    """

    cell: NDArray[np.uint32]
    time: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.cell)

    @classmethod
    def of(cls, cell: NDArray[np.uint32], time: NDArray[np.float64], base: TimeBase) -> "Ends":
        """From statements (k,) in any order.

        >>> some = Ends.of(np.array([1, 0, 1], np.uint32), np.array([61.0, 5.0, 70.0]), TimeBase(0.0, 60.0))
        >>> some.cell.tolist(), some.time.tolist()
        ([0, 1], [5.0, 70.0])
        """
        order = np.lexsort((time, cell))
        cell, time = cell[order], time[order]
        sample = base.sample(time)
        last = np.ones(len(cell), np.bool_)
        last[:-1] = (cell[1:] != cell[:-1]) | (sample[1:] != sample[:-1])
        return cls(cell[last], time[last])

    def select(self, rows: NDArray[np.bool_]) -> "Ends":
        """Some of them."""
        return Ends(self.cell[rows], self.time[rows])


def joined(one: Ends | None, other: Ends | None, base: TimeBase) -> Ends | None:
    """Both together; None is none."""
    if one is None or other is None:
        return one or other
    return Ends.of(np.concatenate([one.cell, other.cell]), np.concatenate([one.time, other.time]), base)

"""Map cells: what is known of a grid at one moment, and what of it is cut out."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tidemap.history.history import FREE, OCCUPIED
from tidemap.space.grid import GridGeometry

UNCERTAIN = 2


@dataclass(frozen=True, slots=True, eq=False)
class MapCells:
    """The known cells of a grid, ascending.

    cell (n,) int64 linear; probability (n,) float32 of being occupied; state (n,) uint8: FREE, OCCUPIED or UNCERTAIN.
    """

    grid: GridGeometry
    cell: NDArray[np.int64]
    probability: NDArray[np.float32]
    state: NDArray[np.uint8]

    def dense_state(self, unknown: int) -> NDArray[np.uint8]:
        """FREE, OCCUPIED, UNCERTAIN or `unknown` of every cell of the grid, (n_cells,)."""
        found = np.full(self.grid.n_cells, unknown, np.uint8)
        found[self.cell] = self.state
        return found

    def dense_probability(self) -> NDArray[np.float32]:
        """The probability of every cell of the grid, (n_cells,), NaN where nothing is known."""
        found = np.full(self.grid.n_cells, np.nan, np.float32)
        found[self.cell] = self.probability
        return found

    def only(self, chosen: NDArray[np.bool_]) -> "MapCells":
        """Some of the cells: chosen (n,)."""
        return MapCells(self.grid, self.cell[chosen], self.probability[chosen], self.state[chosen])

    def band(self, z_min: float | None, z_max: float | None) -> "MapCells":
        """The layers with their centre in [z_min, z_max] (metres, closed), as a grid of their own.

        Raises ValueError where there is none.
        """
        nx, ny, nz = self.grid.shape3
        z = self.grid.origin[2] + (np.arange(nz) + 0.5) * self.grid.resolution_m
        low, high = (-np.inf if z_min is None else z_min), (np.inf if z_max is None else z_max)
        layers = np.flatnonzero((z >= low) & (z <= high))
        if not layers.size:
            raise ValueError(
                f"no layer has its centre in it; those of this location are {z[0]:.6g} to {z[-1]:.6g} m high"
            )
        first, n = int(layers[0]), len(layers)
        x, y, _ = self.grid.origin
        grid = replace(
            self.grid, origin=(x, y, float(self.grid.origin[2] + first * self.grid.resolution_m)), shape=(nx, ny, n)
        )
        layer = self.cell % nz
        kept = (layer >= first) & (layer < first + n)
        cell = self.cell[kept] // nz * n + layer[kept] - first
        return MapCells(grid, cell, self.probability[kept], self.state[kept])

    def flattened(self) -> "MapCells":
        """One layer of all: occupied where any cell above another is, free where all that are known are free.

        Others are uncertain. The probability is the highest of a column's.
        """
        nx, ny, nz = self.grid.shape3
        grid = replace(self.grid, shape=(nx, ny))
        column = self.cell // nz
        first = np.flatnonzero(np.diff(column, prepend=-1))
        if not first.size:
            return MapCells(grid, self.cell, self.probability, self.state)
        occupied = np.logical_or.reduceat(self.state == OCCUPIED, first)
        free = np.logical_and.reduceat(self.state == FREE, first)
        state = np.where(occupied, OCCUPIED, np.where(free, FREE, UNCERTAIN)).astype(np.uint8)
        return MapCells(grid, column[first], np.maximum.reduceat(self.probability, first), state)

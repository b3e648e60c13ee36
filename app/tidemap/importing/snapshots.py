"""Snapshots: records on a location's grid, as the measurements that are posted."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tidemap.formats.npy import UNSEEN
from tidemap.history.history import FREE, OCCUPIED
from tidemap.importing.records import StateReadings, WholeMap
from tidemap.space.grid import GridGeometry
from tidemap.space.rays import SeenCells, cast_rays
from tidemap.space.sweep import Sweep

BLOCK_CELLS = 1 << 20


@dataclass(frozen=True, slots=True, eq=False)
class SnapshotColumns:
    """time (n,) float64 Unix seconds, state (n,); cell (n,) uint32, None for a location of kind `state`."""

    time: NDArray[np.float64]
    state: NDArray[np.uint8] | NDArray[np.float32]
    cell: NDArray[np.uint32] | None

    def __len__(self) -> int:
        return len(self.time)


def snapshot_of(record: StateReadings | WholeMap | Sweep, grid: GridGeometry, min_hits: int) -> SnapshotColumns:
    """A record on a location's grid, into which it fits; readings are of a location of kind `state`."""
    if isinstance(record, StateReadings):
        return SnapshotColumns(record.time, record.state, None)
    if isinstance(record, WholeMap):
        seen = resampled(record.grid, record.state, grid)
    else:
        ends = record.ends()
        origin = record.map_from_sensor.translation
        seen = cast_rays(grid, origin, ends, max_range_m=record.max_range_m, min_hits=min_hits)
    return SnapshotColumns(np.full(len(seen.cell), record.time), seen.state, seen.cell)


def resampled(from_grid: GridGeometry, state: NDArray[np.uint8], grid: GridGeometry) -> SeenCells:
    """A map (n_cells,) on another grid: a cell is occupied where the centre of an occupied one is in it.

    It is free where only those of free ones are. What is outside is left out, and so is the height where the other grid
    has one layer. A map with larger cells leaves gaps.
    """
    found = np.full(grid.n_cells, UNSEEN, np.uint8)
    for wanted in (FREE, OCCUPIED):  # occupied wins
        known = np.flatnonzero(state == wanted)
        for first in range(0, len(known), BLOCK_CELLS):
            found[_cells_at(from_grid.centre(known[first : first + BLOCK_CELLS]), grid)] = wanted
    cell = np.flatnonzero(found != UNSEEN)
    return SeenCells(cell.astype(np.uint32), found[cell])


def _cells_at(points: NDArray[np.float64], grid: GridGeometry) -> NDArray[np.int64]:
    """The linear cells that points (n, 3) are in, without those outside."""
    index = np.floor((points - np.array(grid.origin)) / grid.resolution_m).astype(np.int64)
    if grid.shape3[2] == 1:
        index[:, 2] = 0
    return grid.cell(index[((index >= 0) & (index < np.array(grid.shape3))).all(axis=1)])

"""What is expected of cells as a map of ROS."""

import numpy as np
from numpy.typing import NDArray

from tidemap.client.ros import UNKNOWN, Header, MapMetaData, OccupancyGrid, Point, PoseMessage, Stamp
from tidemap.schemas.locations import Grid
from tidemap.schemas.maps import ExportMode

UNCERTAIN = 50
"""Of a cell, in percent, until layers become one: with a free one it stays uncertain, with an occupied one not."""


def percent_of(probability: NDArray[np.float32], verdict: NDArray[np.str_], mode: ExportMode) -> NDArray[np.int8]:
    """Of cells (n,) the probability in percent; in mode "trinary" 100, 0 or UNCERTAIN."""
    if mode == "trinary":
        return np.select([verdict == "occupied", verdict == "free"], [100, 0], UNCERTAIN).astype(np.int8)
    return np.rint(100 * probability).astype(np.int8)


def map_message(
    percent: NDArray[np.int8], grid: Grid, time_s: float, mode: ExportMode, z_min: float, z_max: float
) -> OccupancyGrid:
    """The map of all cells (n_cells,) of a grid, UNKNOWN where nothing is known.

    Of several layers each cell has the highest value of those whose centres are from `z_min` to `z_max` (metres).
    """
    nx, ny, nz = (*grid.shape, 1)[:3]
    layers = percent.reshape(nx, ny, nz)
    if nz > 1:
        height = grid.origin[2] + (np.arange(nz) + 0.5) * grid.resolution_m
        layers = layers[:, :, (height >= z_min) & (height <= z_max)]
    flat = np.max(layers, axis=2, initial=UNKNOWN)
    if mode == "trinary":
        flat[flat == UNCERTAIN] = UNKNOWN
    stamp, origin = Stamp.of(time_s), PoseMessage(Point(*grid.origin))
    info = MapMetaData(stamp, grid.resolution_m, nx, ny, origin)
    return OccupancyGrid(Header(stamp, grid.frame), info, flat.T.ravel())

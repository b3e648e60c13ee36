"""Surfaces: what is expected to be occupied around a sensor, as its scans are aligned to it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tidemap.services.context import Context
from tidemap.services.spectra import Fitted
from tidemap.space.alignment import Surface
from tidemap.space.centroids import surface_centroids
from tidemap.space.grid import GridGeometry
from tidemap.space.scan import Scan
from tidemap.spectral.prediction import predict
from tidemap.storage.records import LocationRecord

BLOCK_M = 10.0
"""Scans whose sensors are in the same block of space see the same surface."""
EVER = 1e9
"""Metres beyond all that a grid reaches."""
MAX_CELLS = 40_000
"""Cells of a surface; of more those nearest to the block are taken."""
OCCUPIED = 0.5
"""Cells of a greater probability are expected to be occupied: s'(t) of the paper."""


@dataclass(frozen=True, slots=True)
class Block:
    """The surroundings of a sensor: a block of space by its index, how many blocks a scan reaches beyond it, and of a
    planar scan in a grid of many layers the layer that it is in."""

    index: tuple[int, int, int]
    reach: int
    layer: int | None
    flat: bool

    @classmethod
    def of(cls, scan: Scan, grid: GridGeometry) -> "Block":
        """That of a scan in a grid."""
        at = scan.map_from_sensor.translation
        ranges = scan.ranges
        reach = float(np.max(ranges, where=ranges <= scan.max_range_m, initial=0.0))
        extent = float(np.max(grid.shape3)) * grid.resolution_m
        layered = grid.shape3[2] > 1
        layer = int(np.floor((at[2] - grid.origin[2]) / grid.resolution_m)) if scan.flat and layered else None
        i, j, k = np.floor(at / BLOCK_M).astype(int).tolist()
        return cls((i, j, k), int(np.ceil(min(reach, extent) / BLOCK_M)), layer, scan.flat or not layered)

    @property
    def bbox(self) -> tuple[float, ...]:
        """[x0, y0, z0, x1, y1, z1] in metres, of all heights where it is flat."""
        half = np.full(3, (self.reach + 0.5) * BLOCK_M)
        half[2] = EVER if self.flat else half[2]
        return (*(self.centre - half).tolist(), *(self.centre + half).tolist())

    @property
    def centre(self) -> NDArray[np.float64]:
        """(3,) in metres."""
        return (np.array(self.index) + 0.5) * BLOCK_M

    def select(self, centres: NDArray[np.float64], grid: GridGeometry) -> NDArray[np.float64]:
        """Those of the centres of cells (n, 3) that are in it, about its centre, at most MAX_CELLS."""
        about = centres - self.centre
        used = 2 if self.flat else 3
        rows = (np.abs(about[:, :used]) <= (self.reach + 0.5) * BLOCK_M).all(axis=1)
        if self.layer is not None:
            middle = grid.origin[2] + (self.layer + 0.5) * grid.resolution_m
            rows &= np.abs(centres[:, 2] - middle) < grid.resolution_m / 2
        about = about[rows]
        if len(about) > MAX_CELLS:
            nearest = np.argpartition(np.einsum("ij,ij->i", about, about), MAX_CELLS)[:MAX_CELLS]
            about = about[np.sort(nearest)]
        return about


def surface_at(ctx: Context, model: Fitted, block: Block, time: float) -> Surface:
    """What the model expects to be occupied at a time (Unix seconds) around a scan; kept for the next ones."""
    location = model.location
    version = (model.revision.revision, int(location.base.sample(time)))

    def make() -> Surface:
        centres = _expected(ctx, location, model, time)
        chosen = block.select(centres, location.cells)
        return Surface(chosen, block.centre, location.cells.resolution_m, block.flat)

    return ctx.caches.surfaces.get((location.id, block), version, make)


def _expected(ctx: Context, location: LocationRecord, model: Fitted, time: float) -> NDArray[np.float64]:
    """Where (n, 3) the cells that are expected to be occupied have their surfaces."""
    if model.chunks is None:
        probability = predict(model.spectrum, time, threads=ctx.settings.update_threads)
        cell = np.flatnonzero(probability > OCCUPIED)
        return surface_centroids(location.cells, cell, probability[cell])
    cell, probability = model.known, model.predict(time, model.known)
    expected = probability > OCCUPIED
    return surface_centroids(location.cells, cell[expected], probability[expected])

"""Proposal: a location that what was found fits into."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tidemap.importing.options import ImportOptions
from tidemap.importing.survey import Findings
from tidemap.space.grid import GridGeometry

FLAT_RESOLUTION_M, RESOLUTION_M = 0.05, 0.1
MAX_PROPOSED_CELLS = 4_000_000
MAX_ROUNDING = 1e-6
"""Cells by which an extent may pass a face."""


def propose(found: Sequence[Findings], options: ImportOptions) -> dict[str, Any]:
    """The settings of a new location as `create_location` takes them, without its name.

    Raises ValueError where nothing that was found has an extent, or only some of it is for a grid.
    """
    settings: dict[str, Any] = {"interval_s": options.interval_s, "time_zone": options.time_zone}
    kinds = {each.kind for each in found}
    if len(kinds) > 1:
        raise ValueError(
            "some of this is for a grid and some for a location of kind 'state'; import one after the other"
        )
    if kinds == {"state"}:
        return {"kind": "state", **settings}
    grid = _grid(found, options)
    kind = "grid2d" if len(grid.shape) == 2 else "grid3d"
    where = {"frame": grid.frame, "origin": list(grid.origin), "resolution_m": grid.resolution_m}
    return {"kind": kind, **settings, "grid": {**where, "shape": list(grid.shape)}}


def _grid(found: Sequence[Findings], options: ImportOptions) -> GridGeometry:
    """That of a map where there is nothing else, or one around all that was seen."""
    first = found[0].grid
    if first is not None and options.resolution_m is None and all(each.grid == first for each in found):
        return first
    low = np.min([each.low for each in found], axis=0)
    high = np.max([each.high for each in found], axis=0)
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        raise ValueError("nothing of this has an extent: every scan is empty or lacks its pose")
    flat = all(each.flat for each in found)
    return _around(low, high, flat, options)


def _around(low: NDArray[np.float64], high: NDArray[np.float64], flat: bool, options: ImportOptions) -> GridGeometry:
    """Faces at multiples of the resolution; without a wish for one it is doubled until the cells are not too many."""
    resolution = options.resolution_m or (FLAT_RESOLUTION_M if flat else RESOLUTION_M)
    axes = 2 if flat else 3
    while True:
        first = np.floor(low[:axes] / resolution + MAX_ROUNDING)
        shape = np.maximum(np.ceil(high[:axes] / resolution - MAX_ROUNDING) - first, 1)
        # A point on the upper border is in the next cell.
        shape += (first + shape) * resolution <= high[:axes]
        if options.resolution_m is not None or shape.prod() <= MAX_PROPOSED_CELLS:
            break
        resolution *= 2
    x, y, z = (*(first * resolution).tolist(), 0.0)[:3]
    return GridGeometry(options.fixed_frame, (x, y, z), resolution, tuple(shape.astype(int).tolist()))

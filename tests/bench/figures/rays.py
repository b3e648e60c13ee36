"""rays: a sweep of 70,000 points cast into a grid of 0.1 m, one thread, against OctoMap inserting the same."""

import time
from importlib.util import find_spec

from tests.bench import sweep
from tests.bench.timing import Figure, interleaved
from tidemap.space.rays import cast_rays

BY_NAME = find_spec("pyoctomap") is None
"""OctoMap has no wheel for some machines."""


def measure() -> Figure:
    """Floor: a fresh tree with the sweep in it. Both are counted in time of the processor."""
    import pyoctomap

    points = sweep.points()

    def cast() -> None:
        cast_rays(sweep.GRID, sweep.ORIGIN, points, max_range_m=sweep.MAX_RANGE_M)

    def insert() -> None:
        pyoctomap.OcTree(sweep.GRID.resolution_m).insertPointCloud(points, sweep.ORIGIN, sweep.MAX_RANGE_M)

    floor, value = interleaved(insert, cast, rounds=5, clock=time.thread_time)
    seen = cast_rays(sweep.GRID, sweep.ORIGIN, points, max_range_m=sweep.MAX_RANGE_M)
    details = {
        "rays": len(points),
        "seen_cells": len(seen.cell),
        "rays_per_s": round(len(points) / value),
        "threads": 1,
    }
    return Figure(value * 1e3, floor * 1e3, 0.25, "ms", details)

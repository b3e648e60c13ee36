"""Ranges of a laser as points, as sensor_msgs/LaserScan and REP 117 mean them."""

from dataclasses import dataclass
from math import inf
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Real = TypeVar("Real", bound=np.floating[Any])
LONGER = 1.0 + 1e-6
"""A range is longer than another from so many times on: float32, which sensors speak, keeps seven digits."""
BEYOND = 2.0
"""At so many times the range up to which it clears is the point of a ray that met nothing."""


@dataclass(frozen=True, slots=True)
class RangeLimits:
    """In metres: a laser measures from `low` to `high`, and its rays clear up to `clear`, at most `high`."""

    low: float = 0.0
    high: float = inf
    clear: float = inf


def points_of_ranges(
    ranges: NDArray[np.floating], angle: NDArray[np.float64], limits: RangeLimits
) -> NDArray[np.float64]:
    """Points (m, 3) of ranges (n,) at angles (n,) in the plane of a laser, x forward and y left; m is at most n.

    Infinity says that nothing was met up to `high`: its point is beyond `clear`, where a ray hits nothing. Without a
    `clear` it says nothing. What is NaN, 0 or outside of [low, high] is left out, for it was not measured; both limits
    are measured, however they were rounded.
    """
    found = np.where(ranges == inf, BEYOND * limits.clear, ranges).astype(np.float64, copy=False)
    with np.errstate(invalid="ignore"):
        inside = (ranges * LONGER >= limits.low) & (ranges <= limits.high * LONGER) & (ranges > 0)
    kept = (inside | (ranges == inf)) & np.isfinite(found)
    found, angle = found[kept], angle[kept]
    return np.stack([found * np.cos(angle), found * np.sin(angle), np.zeros(len(found))], axis=1)


def measured(points: NDArray[Real]) -> NDArray[Real]:
    """Those of the points (n, 3) in a sensor's frame that were measured.

    NaN and infinity have no direction; nor has the sensor's own place, (0, 0, 0), which many drivers write for no echo.
    """
    found: NDArray[Real] = points[np.isfinite(points).all(axis=1) & points.any(axis=1)]
    return found

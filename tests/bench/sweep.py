"""A sweep of a spinning lidar in a room, for the figures."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from tidemap.space.grid import GridGeometry

BEAMS, TURNS, NOISE = 64, 1094, 0.005
"""70,016 rays; standard deviation of a range as a share of it."""
WALLS = np.array([[-6.0, -4.0, -1.2], [7.0, 5.0, 1.8]])
"""Of the room, seen from the sensor."""
ORIGIN = np.array([0.013, 0.021, 0.037])
GRID = GridGeometry("map", (-10.0, -10.0, -3.0), 0.1, (200, 200, 60))
MAX_RANGE_M = 10.0


@cache
def points() -> NDArray[np.float64]:
    """Ends (n, 3) in the grid's frame, column by column as they are measured."""
    azimuth = np.repeat(np.linspace(-np.pi, np.pi, TURNS, endpoint=False) + 1e-3, BEAMS)
    elevation = np.tile(np.linspace(-0.35, 0.35, BEAMS), TURNS)
    flat = np.cos(elevation)
    way = np.stack([np.cos(azimuth) * flat, np.sin(azimuth) * flat, np.sin(elevation)], axis=1)
    length = np.maximum(WALLS[0] / way, WALLS[1] / way).min(axis=1)
    noisy = length * np.random.default_rng(4).normal(1.0, NOISE, len(length))
    return np.asarray(ORIGIN + way * noisy[:, np.newaxis])

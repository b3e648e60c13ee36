"""The areas that the robot visits with its sensors, as the paper's laboratory: two corners of the lab and a corridor.

Their maps have cells half as large as the plan's and shifted by half a cell, so that surfaces run through the middle
of cells: on a border the noise of a sensor would decide which cell they are in.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tidemap.demo import plan
from tidemap.demo.civil import Moment
from tidemap.demo.plan import Cells, Seat
from tidemap.space.grid import GridGeometry

RESOLUTION_M = plan.RESOLUTION_M / 2
LASER_M, CAMERA_M = 0.3, 1.1
"""How high the sensors are; the laser sees the second layer of the plan's cells."""
LASER_LAYER = 1

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Passing:
    """How likely somebody walks through during a visit, in local hours [start, stop) of workdays."""

    start: float
    stop: float
    chance: float


@dataclass(frozen=True)
class Area:
    """A part of the plan: cells x and y from the first to the last, and all layers.

    stand: where the robot stops; path: from where to where people walk through; both x, y in metres of the map.
    """

    number: int
    name: str
    x: tuple[int, int]
    y: tuple[int, int]
    stand: Point
    path: tuple[Point, Point]
    seats: tuple[Seat, ...]
    passing: tuple[Passing, ...]

    @cached_property
    def grid(self) -> GridGeometry:
        """The cells of its 3D map."""
        (x, x_last), (y, y_last) = self.x, self.y
        shape = tuple(2 * n + 1 for n in (x_last - x + 1, y_last - y + 1, plan.SHAPE[2]))
        origin = tuple(n * plan.RESOLUTION_M - RESOLUTION_M / 2 for n in (x, y, 0))
        return GridGeometry("map", (origin[0], origin[1], origin[2]), RESOLUTION_M, shape)

    @cached_property
    def floor_grid(self) -> GridGeometry:
        """The cells of its 2D map, at the height of the laser."""
        x, y, _ = self.grid.origin
        return GridGeometry("map", (x, y, 0.0), RESOLUTION_M, self.grid.shape[:2])

    def truth(self, occupancy: Cells) -> Cells:
        """Which cells of the 3D map have something in them, (n_cells,), of the plan's occupied cells."""
        return _touched(self._halved(occupancy, slice(None)), 3).ravel()

    def floor_truth(self, occupancy: Cells) -> Cells:
        """The same of the 2D map."""
        layer = self._halved(occupancy, slice(LASER_LAYER, LASER_LAYER + 1))[:, :, 1]
        return _touched(layer, 2).ravel()

    def _halved(self, occupancy: Cells, layers: slice) -> Cells:
        """Cells of half the size, with one more on each side, where there may be a neighbour."""
        around = np.pad(occupancy[:, :, layers], 1)
        (x, x_last), (y, y_last) = self.x, self.y
        near = around[x : x_last + 3, y : y_last + 3]
        for axis in range(3):
            near = np.repeat(near, 2, axis=axis)
        return near[1:-1, 1:-1, 1:-1]

    def passes(self, now: Moment) -> float:
        """How likely somebody walks through."""
        return next((each.chance for each in self.passing if now.workday and each.start <= now.hour < each.stop), 0.0)


def _touched(halved: Cells, axes: int) -> Cells:
    """Cells that lie half over one and half over the next of `halved`, along each of its first axes."""
    for axis in range(axes):
        halved = np.delete(halved, 0, axis) | np.delete(halved, -1, axis)
    return halved


_LAB_HOURS = (Passing(8.5, 17.5, 0.08),)
_CORRIDOR_HOURS = (
    Passing(8.0, 9.5, 0.9),
    Passing(12.0, 13.5, 0.9),
    Passing(16.0, 18.0, 0.9),
    Passing(9.5, 16.0, 0.1),
)
AREAS = (
    Area(0, "lab-west", (0, 19), (23, 39), (1.7, 5.6), ((2.5, 4.9), (2.6, 6.2)), plan.LAB_SEATS[:2], _LAB_HOURS),
    Area(1, "lab-east", (15, 38), (23, 39), (5.9, 5.7), ((4.6, 5.0), (7.4, 5.0)), plan.LAB_SEATS[2:], _LAB_HOURS),
    Area(2, "corridor", (0, 31), (16, 28), (2.5, 4.3), ((1.4, 3.75), (6.2, 3.75)), (), _CORRIDOR_HOURS),
)
"""The corridor's map reaches through the door of the lab: along bare walls nothing would hold a laser's scan."""

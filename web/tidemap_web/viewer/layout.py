"""Where things stand in the scene: metres of the grid's frame, the right grid moved aside along x."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tidemap.space.grid import GridGeometry

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Tick:
    """A number on an edge of the floor, at (x, y) in metres."""

    name: str
    text: str
    at: tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """One grid drawn twice, `beside` each other, or once.

    In metres, (3,) each: `low` and `high`, the bounds of the observed cells; `shift`, added to draw the right grid.
    `flat` says that it is a floor plan and no volume; `titles` are those of the left grid and of the right one.
    """

    grid: GridGeometry
    low: Vector
    high: Vector
    shift: Vector
    flat: bool
    titles: tuple[str, ...]

    @property
    def beside(self) -> bool:
        """Whether there are two grids."""
        return len(self.titles) > 1

    @property
    def size(self) -> Vector:
        """Extent (3,) of one grid in metres."""
        return self.high - self.low

    def same_as(self, other: "Layout | None") -> bool:
        """Whether another layout puts everything at the same places."""
        if other is None or self.grid != other.grid or self.titles != other.titles:
            return False
        return np.array_equal(self.low, other.low) and np.array_equal(self.high, other.high)

    @property
    def lines_m(self) -> float:
        """Distance between the lines on the floor."""
        return floor_step(float(max(self.size[:2])))

    @property
    def marker_m(self) -> float:
        """Half the size of a marker: seen from far, and no smaller than a cell."""
        return max(0.6 * self.grid.resolution_m, 0.018 * float(max(self.size[:2])))

    @property
    def margin_m(self) -> float:
        """How far from the floor its numbers stand."""
        return 0.35 * self.lines_m

    def ticks(self) -> Iterator[Tick]:
        """Every other line of the floor in metres of the grid's frame, along its front and its left edge."""
        step = 2 * self.lines_m
        margin = self.margin_m
        for axis, name in enumerate("xy"):
            first, last = math.ceil(self.low[axis] / step - 1e-9), math.floor(self.high[axis] / step + 1e-9)
            for number in range(first, last + 1):
                along = number * step
                at = (along, self.low[1] - margin) if axis == 0 else (self.low[0] - margin, along)
                text = f"{name} {along:g} m" if number == last else f"{along:g}"
                yield Tick(f"{name}{number}", text, (float(at[0]), float(at[1])))


@dataclass(frozen=True, slots=True, eq=False)
class Bounds:
    """The box around the observed cells of a grid, `low` and `high` (3,) in metres."""

    grid: GridGeometry
    low: Vector
    high: Vector

    @classmethod
    def of(cls, grid: GridGeometry, index: NDArray[np.int32]) -> "Bounds":
        """Around cells `index` (n, 3)."""
        low, high = np.array(grid.box_at(index)).reshape(2, 3)
        return cls(grid, low, high)


def arrange(around: Bounds, flat: bool, titles: tuple[str, ...]) -> Layout:
    """Place a grid for each title, the second a tenth (two cells) aside."""
    low, high = around.low, around.high
    gap = max(2.0 * around.grid.resolution_m, 0.12 * float(max(high[:2] - low[:2])))
    aside = float(high[0] - low[0]) + gap if len(titles) > 1 else 0.0
    return Layout(around.grid, low, high, np.array([aside, 0.0, 0.0]), flat, titles)


def floor_step(extent_m: float) -> float:
    """A round distance for the lines on the floor: 1, 2 or 5 times a power of ten, at most some 12 lines.

    >>> floor_step(9.0), floor_step(14.0), floor_step(60.0)
    (1.0, 2.0, 5.0)
    """
    rough = max(extent_m, 1e-6) / 12.0
    power = 10.0 ** math.floor(math.log10(rough))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= rough)


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """A pose in metres: where the camera is and what it looks at."""

    position: Vector
    look_at: Vector


def camera_pose(layout: Layout, aspect: float, fov: float, from_above: bool) -> Camera:
    """The nearest camera that sees all grids and the numbers on their edges; `fov` is vertical, in radians.

    The camera stands south of the grids and above, so x points right and the predicted grid is on the left.
    """
    corners = _corners(layout)
    target = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
    away = np.array([0.0, -1e-3, 1.0]) if from_above else np.array([0.0, -0.62, 0.85])
    away /= np.linalg.norm(away)
    right = np.array([1.0, 0.0, 0.0])
    up = np.cross(away, right)
    half_height = math.tan(fov / 2.0) * 0.9
    half_width = half_height * max(aspect, 0.1)
    offset = corners - target
    needed = np.maximum(np.abs(offset @ right) / half_width, np.abs(offset @ up) / half_height)
    distance = float(np.max(needed + offset @ away))
    return Camera(target + away * distance, target)


def _corners(layout: Layout) -> Vector:
    numbers = 2 * layout.margin_m * np.array([1.0, 1.0, 0.0])
    low, high = layout.low - numbers, layout.high + layout.shift
    grid = np.meshgrid(*([low[i], high[i]] for i in range(3)), indexing="ij")
    return np.stack([axis.ravel() for axis in grid], axis=1)

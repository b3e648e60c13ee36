"""Ranges: the first occupied cell on a ray, against boxes whose ranges are known exactly."""

import numpy as np
import pytest

from tests.support.rooms import Room, around, level
from tidemap.space.first_ranges import first_ranges
from tidemap.space.grid import GridGeometry

GRID = GridGeometry("map", (-1.0, -2.0, 0.0), 0.5, (20, 16, 8))
THINGS = ((slice(8, 11), slice(2, 4), slice(0, 3)), (slice(3, 4), slice(9, 14), slice(2, 8)))


def cells() -> np.ndarray:
    occupied = np.zeros(GRID.shape, bool)
    for axis in range(3):
        for end in (0, -1):
            np.moveaxis(occupied, axis, 0)[end] = True
    for thing in THINGS:
        occupied[thing] = True
    return occupied


def room() -> Room:
    """The same as boxes: cells at the border are walls."""
    low, high = np.array(GRID.origin), np.array(GRID.origin) + 0.5 * np.array(GRID.shape)
    corners = [[[axis.start for axis in thing], [axis.stop for axis in thing]] for thing in THINGS]
    return Room(np.array([low + 0.5, high - 0.5]), np.array(GRID.origin) + 0.5 * np.array(corners))


def test_ranges_are_those_of_the_boxes_that_the_cells_make_up() -> None:
    chance = np.random.default_rng(1)
    for _ in range(5):
        x, y, z = chance.uniform((1.2, 0.3, 1.6), (2.8, 4.5, 3.0)).tolist()
        pose = level(x, y, z, 0.0)
        ways = around(3000, chance, height=np.pi)
        found = first_ranges(GRID, cells(), pose.translation, ways, 30.0)
        np.testing.assert_allclose(found, room().ranges(pose, ways), atol=1e-9)


@pytest.mark.parametrize(("start", "way", "expected"), [
    ((0.25, 0.25, 0.25), (0, 0, 1), 1.25),
    ((0.25, 0.25, 0.25), (0, 0, -1), np.inf),
    ((0.25, 0.25, 1.75), (0, 0, 1), 0.0),
    ((0.25, 0.25, 9.25), (0, 0, -1), 7.25),
    ((5.25, 5.25, 0.25), (1, 0, 0), np.inf),
])  # fmt: skip
def test_rays_that_meet_nothing_or_begin_inside(
    start: tuple[float, ...], way: tuple[float, ...], expected: float
) -> None:
    occupied = np.zeros((4, 4, 4), bool)
    occupied[:, :, 3] = True
    grid = GridGeometry("map", (0.0, 0.0, 0.0), 0.5, (4, 4, 4))
    assert first_ranges(grid, occupied, start, [way], 20.0).tolist() == [expected]


def test_what_is_too_far_is_not_met() -> None:
    occupied = np.zeros((9, 1, 1), bool)
    occupied[8] = True
    grid = GridGeometry("map", (0.0, 0.0, 0.0), 0.5, (9, 1, 1))
    for longest, expected in ((3.8, 3.75), (3.7, np.inf)):
        assert first_ranges(grid, occupied, (0.25, 0.25, 0.25), [(1, 0, 0)], longest)[0] == pytest.approx(expected)

"""Surfaces that scans are aligned to: centroids of cells, and what of a map is around a sensor."""

import numpy as np
import pytest

from tests.support.rooms import level
from tidemap.services.surfaces import BLOCK_M, MAX_CELLS, Block
from tidemap.space.centroids import surface_centroids
from tidemap.space.grid import GridGeometry
from tidemap.space.scan import Scan

GRID = GridGeometry("map", (-1.0, 2.0, 0.5), 0.5, (6, 5, 4))


def slow(cell: int, cells: list[int], weights: dict[int, float]) -> np.ndarray:
    """The weighted mean of the centres of the cells that touch one, from the definition."""
    index = GRID.index([cell])[0]
    near = [each for each in cells if np.abs(GRID.index([each])[0] - index).max() <= 1]
    return np.average(GRID.centre(near), axis=0, weights=[weights[each] for each in near])


def test_a_centroid_is_the_mean_of_cells_that_touch() -> None:
    chance = np.random.default_rng(2)
    cell = np.sort(chance.choice(GRID.n_cells, 40, replace=False))
    weight = chance.uniform(0.5, 1.0, 40)
    weights = dict(zip(cell.tolist(), weight.tolist(), strict=True))
    expected = [slow(each, cell.tolist(), weights) for each in cell.tolist()]
    np.testing.assert_allclose(surface_centroids(GRID, cell, weight), expected, atol=1e-12)


def test_no_cell_has_no_centroid() -> None:
    assert surface_centroids(GRID, np.zeros(0, np.int64), np.zeros(0)).shape == (0, 3)


HALL = GridGeometry("map", (0.0, 0.0, 0.0), 0.5, (200, 200, 8))


def scan(x: float, reach: float, *, flat: bool = False) -> Scan:
    points = np.array([[reach, 0.0, 0.0]], np.float32)
    return Scan(points, level(x, 12.0, 1.6, 0.0), flat=flat)


def test_sensors_near_one_another_see_the_same_surface() -> None:
    assert Block.of(scan(11.0, 5.0), HALL) == Block.of(scan(19.0, 8.0), HALL)
    assert Block.of(scan(11.0, 5.0), HALL) != Block.of(scan(21.0, 5.0), HALL)


@pytest.mark.parametrize("flat", [False, True])
def test_all_that_a_scan_can_reach_is_in_it(flat: bool) -> None:
    looked = scan(14.0, 17.0, flat=flat)
    centres = HALL.centre(np.arange(HALL.n_cells))
    block = Block.of(looked, HALL)
    found = block.select(centres, HALL) + block.centre
    distance = np.linalg.norm(centres[:, :2] - looked.map_from_sensor.translation[:2], axis=1)
    near = centres[distance <= 17.0]
    if flat:
        near = near[near[:, 2] == 1.75]
        assert set(found[:, 2].round(9)) == {1.75}, "of a planar scan its own layer alone"
    assert {tuple(row) for row in near.round(6)} <= {tuple(row) for row in found.round(6)}
    assert np.abs(found - block.centre)[:, :2].max() <= 2.5 * BLOCK_M


def test_of_too_many_cells_the_nearest_are_taken() -> None:
    fine = GridGeometry("map", (0.0, 0.0, 0.0), 0.25, (200, 200, 8))
    centres = fine.centre(np.arange(fine.n_cells))
    block = Block.of(scan(14.0, 40.0), fine)
    found = block.select(centres, fine)
    assert len(found) == MAX_CELLS
    left = len(centres) - MAX_CELLS
    assert np.sort(np.linalg.norm(centres - block.centre, axis=1))[-left] >= np.linalg.norm(found, axis=1).max() - 1e-9

"""Which cells are shown in which colour."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.unit.web.states import NOW, FakeState
from tidemap.space.grid import GridGeometry
from tidemap_web.viewer import colors
from tidemap_web.viewer.cells import Ground, Picture, Taste, picture

GRID = GridGeometry("map", (0.0, 0.0, 0.0), 0.5, (2, 3, 4))


def paint(state: FakeState, usual: NDArray[np.float32] | None = None) -> Picture:
    return picture(state, Ground.of(GRID, state.cell), usual, Taste(floor=0.1, fresh_s=3600))


def test_predicted_cells_have_the_colour_of_their_probability_above_the_floor() -> None:
    shown = paint(FakeState()).predicted
    assert shown.row.tolist() == [0, 1]
    assert shown.index.tolist() == [[0, 0, 0], [0, 1, 1]]
    assert shown.color.tolist() == colors.of_probability(np.array([1.0, 0.5])).tolist()


def test_observed_cells_are_occupied_unexpected_missing_or_stale() -> None:
    state = FakeState(
        cell=np.arange(7),
        probability=np.array([0.95, 0.05, 0.95, 0.05, 0.95, 0.5, 0.05], np.float32),
        observed=np.array([1, 1, 0, 0, 1, 2, 1], np.uint8),
        observed_time=np.array([NOW, NOW, NOW, NOW, NOW - 9999, np.nan, NOW - 9999]),
    )
    seen = paint(state)
    marks = dict(zip(seen.observed.row.tolist(), map(tuple, seen.observed.color.tolist()), strict=True))
    assert marks == {
        0: colors.OCCUPIED,
        1: colors.UNEXPECTED,
        2: colors.MISSING,
        4: colors.STALE,
        6: colors.STALE,  # too long ago to be judged
    }
    assert (seen.unexpected, seen.missing, seen.stale) == (1, 1, 2)


def test_the_confidence_decides_what_is_marked() -> None:
    state = FakeState(
        cell=np.array([0]),
        probability=np.array([0.3], np.float32),
        observed=np.array([1], np.uint8),
        observed_time=np.array([NOW]),
    )
    assert paint(replace(state, confidence=0.6)).unexpected == 1
    assert paint(replace(state, confidence=0.8)).unexpected == 0


def test_what_is_always_occupied_is_grey_and_lighter_where_it_is_higher() -> None:
    usual = np.array([0.99, 0.5, 0.99], np.float32)
    probability = np.array([0.99, 0.99, 0.96], np.float32)
    seen = paint(FakeState(probability=probability, observed=np.array([1, 1, 1], np.uint8)), usual)
    low, high = colors.STRUCTURE
    assert seen.predicted.color.tolist() == [
        list(low),
        colors.of_probability(probability)[1].tolist(),
        list(high),
    ]
    assert seen.observed.color.tolist() == [list(low), list(colors.OCCUPIED), list(high)]
    assert seen.structure == 2


def test_structure_that_is_gone_is_marked() -> None:
    usual = np.full(3, 0.99, np.float32)
    state = FakeState(probability=usual, observed=np.array([1, 0, 1], np.uint8))
    assert paint(state, usual).observed.color[1].tolist() == list(colors.MISSING)


def test_without_sightings_nothing_is_observed() -> None:
    seen = paint(FakeState(observed=None, observed_time=None))
    assert len(seen.observed.row) == 0


def test_a_flat_grid_lies_on_the_ground() -> None:
    ground = Ground.of(GridGeometry("map", (0.0, 0.0, 0.0), 0.5, (2, 3)), np.array([0, 5]))
    assert ground.index.tolist() == [[0, 0, 0], [1, 2, 0]]


@given(st.lists(st.floats(0, 1), min_size=2, max_size=50))
def test_the_scale_grows_brighter(probabilities: list[float]) -> None:
    ordered = np.sort(np.array(probabilities))
    luminance = colors.of_probability(ordered) @ np.array([0.2126, 0.7152, 0.0722])
    assert (np.diff(luminance) >= -0.5).all()


@pytest.mark.parametrize("mark", [colors.UNEXPECTED, colors.MISSING, colors.STALE, colors.SELECTED, *colors.STRUCTURE])
def test_no_mark_is_a_colour_of_the_scale(mark: colors.Rgb) -> None:
    distance = np.abs(colors.SCALE.astype(int) - np.array(mark)).max(axis=1)
    assert distance.min() > 3

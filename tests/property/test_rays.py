"""Rays against the slow truth, and what holds for all of them."""

from fractions import Fraction
from math import inf, nan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.support.slow_rays import SLIVER, exact_states, met
from tidemap.space.grid import GridGeometry
from tidemap.space.rays import MAX_MIN_HITS, SeenCells, cast_rays

Point = tuple[float, float, float]
SHAPES = st.lists(st.integers(1, 7), min_size=2, max_size=3).map(tuple)
EIGHTHS = st.integers(-24, 80).map(lambda n: n / 8)
"""Coordinates in cells: rays through edges, corners and along faces are common, and nothing is rounded."""
ANYWHERE = st.one_of(st.floats(-3, 10), EIGHTHS, st.floats(-1e6, 1e6))
quick = settings(max_examples=150)


def points(coordinate: st.SearchStrategy[float]) -> st.SearchStrategy[Point]:
    return st.tuples(coordinate, coordinate, coordinate)


def unit_grid(shape: tuple[int, ...]) -> GridGeometry:
    return GridGeometry("map", (0.0, 0.0, 0.0), 1.0, shape)


def as_states(grid: GridGeometry, seen: SeenCells) -> dict[tuple[int, ...], int]:
    """The state by [i, j, k]; checks the form on the way."""
    assert seen.cell.dtype == np.uint32
    assert seen.state.dtype == np.uint8
    assert (np.diff(seen.cell.astype(np.int64)) > 0).all()
    index = map(tuple, grid.index(seen.cell).tolist())
    return dict(zip(index, seen.state.tolist(), strict=True))


def as_array(ends: list[Point]) -> NDArray[np.float64]:
    return np.array(ends, np.float64).reshape(-1, 3)


def exact(grid: GridGeometry, point: Point) -> list[Fraction]:
    """A point in cells; on a flat grid in the middle of its layer."""
    x, y, z = map(Fraction, point)
    return [x, y, Fraction(1, 2) if grid.shape3[2] == 1 else z]


@settings(max_examples=400)
@given(SHAPES, points(EIGHTHS), st.lists(points(EIGHTHS), max_size=6), st.integers(1, 3))
def test_cells_are_exactly_those_of_the_definition(
    shape: tuple[int, ...], start: Point, ends: list[Point], min_hits: int
) -> None:
    grid = unit_grid(shape)
    truth = exact_states(grid.shape3, exact(grid, start), [exact(grid, end) for end in ends], min_hits)
    assert as_states(grid, cast_rays(grid, start, as_array(ends), min_hits=min_hits)) == truth


@settings(max_examples=400)
@given(SHAPES, points(ANYWHERE), points(ANYWHERE), st.one_of(st.just(inf), st.floats(1e-3, 20)))
def test_any_ray_is_right_but_for_slivers(shape: tuple[int, ...], start: Point, end: Point, max_range: float) -> None:
    grid = unit_grid(shape)
    one, other = np.array(start), np.array(end)
    if grid.shape3[2] == 1:
        one[2] = other[2] = 0.5
    length = float(np.linalg.norm(other - one))
    cut = length > max_range
    stop = one + (other - one) * (max_range / length) if cut else other
    states = as_states(grid, cast_rays(grid, start, [end], max_range_m=max_range))
    free = np.zeros(grid.shape3, bool)
    for cell in (cell for cell, state in states.items() if not state):
        free[cell] = True
    # A coordinate of 1e6 has its neighbours 1e-10 away.
    margin = SLIVER * max(1.0, float(np.abs([one, other]).max()))
    near = met(grid.shape3, stop, stop, margin)
    assert not (free & ~met(grid.shape3, one, stop, margin)).any()
    assert not (met(grid.shape3, one, stop, -margin) & ~near & ~free).any()
    hit = {tuple(np.floor(end if grid.shape3[2] > 1 else (*end[:2], 0)).astype(int).tolist())} & set(
        np.ndindex(grid.shape3)
    )
    if abs(length - max_range) > margin:
        assert {cell for cell, state in states.items() if state} == (set() if cut else hit)


@quick
@given(SHAPES, points(ANYWHERE), st.lists(points(ANYWHERE), max_size=8), st.data())
def test_the_order_of_rays_does_not_matter(
    shape: tuple[int, ...], start: Point, ends: list[Point], data: st.DataObject
) -> None:
    grid = unit_grid(shape)
    min_hits = data.draw(st.integers(1, 3))
    shuffled = data.draw(st.permutations(ends))
    one, other = (
        cast_rays(grid, start, as_array(each), max_range_m=8.0, min_hits=min_hits) for each in (ends, shuffled)
    )
    assert as_states(grid, one) == as_states(grid, other)


@quick
@given(SHAPES, points(ANYWHERE), st.lists(points(ANYWHERE), max_size=8), st.integers(0, 8))
def test_a_scan_in_two_parts_is_their_union_and_hits_win(
    shape: tuple[int, ...], start: Point, ends: list[Point], at: int
) -> None:
    grid = unit_grid(shape)
    one, other, whole = (
        as_states(grid, cast_rays(grid, start, as_array(each))) for each in (ends[:at], ends[at:], ends)
    )
    assert whole == {cell: max(one.get(cell, 0), other.get(cell, 0)) for cell in {*one, *other}}


@quick
@given(points(EIGHTHS), st.lists(points(EIGHTHS), max_size=5), st.sampled_from([0.05, 0.1, 0.25, 2.0]))
def test_only_the_unit_of_length_changes_with_the_resolution(
    start: Point, ends: list[Point], resolution: float
) -> None:
    """On half of a sixteenth off the faces, so that rounded coordinates are in the same cells."""
    shape, off = (5, 6, 4), 1 / 32
    moved = GridGeometry("map", (-3.0, 7.0, 0.5), resolution, shape)
    one, other = (np.array(start) + off, as_array(ends) + off)
    scaled = cast_rays(
        moved, one * resolution + moved.origin, other * resolution + moved.origin, max_range_m=4.015 * resolution
    )
    plain = cast_rays(unit_grid(shape), one, other, max_range_m=4.015)
    hits = [{cell for cell, state in as_states(moved, each).items() if state} for each in (scaled, plain)]
    assert hits[0] == hits[1]


def line(end: float, **options: float) -> dict[int, int]:
    """States along x of a ray from .5, on a row of ten cells of a metre."""
    seen = cast_rays(unit_grid((10, 1, 1)), (0.5, 0.5, 0.5), [(end, 0.5, 0.5)], **options)  # type: ignore[arg-type]
    return dict(zip(seen.cell.tolist(), seen.state.tolist(), strict=True))


def test_a_long_ray_is_cut_hits_nothing_and_leaves_out_its_last_cell() -> None:
    assert line(3.5) == {0: 0, 1: 0, 2: 0, 3: 1}
    assert line(3.5, max_range_m=3.0) == {0: 0, 1: 0, 2: 0, 3: 1}
    assert line(3.5, max_range_m=2.9) == {0: 0, 1: 0, 2: 0}
    assert line(9.5, max_range_m=2.25) == {0: 0, 1: 0}
    assert line(9.5, max_range_m=0.25) == {}
    assert line(1e9) == dict.fromkeys(range(10), 0)
    assert line(1e9, max_range_m=50.0) == dict.fromkeys(range(10), 0)
    assert line(3e38, max_range_m=2.25) == {0: 0, 1: 0}, "however far its end is said to be"
    assert line(3e38) == {}


def test_a_cut_ray_goes_no_further_along_a_slope() -> None:
    seen = cast_rays(unit_grid((9, 9)), (0.5, 0.5, 0.0), [(6.5, 8.5, 0.0)], max_range_m=5.0)
    to_stop = cast_rays(unit_grid((9, 9)), (0.5, 0.5, 0.0), [(3.5, 4.5, 0.0)])
    assert seen.state.tolist() == [0] * (len(to_stop.cell) - 1)
    assert seen.cell.tolist() == to_stop.cell[to_stop.state == 0].tolist()


def test_a_ray_from_outside_to_outside_crosses_the_grid() -> None:
    seen = cast_rays(unit_grid((4, 4)), (-5.0, 1.5, 9.0), [(50.0, 1.5, -9.0)])
    assert seen.cell.tolist() == [1, 5, 9, 13]
    assert seen.state.tolist() == [0, 0, 0, 0]
    assert len(cast_rays(unit_grid((4, 4)), (-5.0, 4.5, 0.0), [(50.0, 4.5, 0.0)]).cell) == 0


@pytest.mark.parametrize("bad", [nan, inf, -inf, 3.4e38, 1e308, -1e308])
def test_ends_that_are_nowhere_are_skipped(bad: float) -> None:
    for end in ((bad, 0.5, 0.5), (5.0, bad, 0.5), (bad, bad, bad)):
        ends = np.array([(2.5, 0.5, 0.5), end]) / 4
        grid = GridGeometry("map", (0.0, 0.0, 0.0), 0.25, (4, 4, 4))
        seen = cast_rays(grid, (0.125, 0.125, 0.125), ends)
        assert seen.cell.tolist() == [0, 16, 32]
        assert seen.state.tolist() == [0, 0, 1]


def test_no_rays_see_nothing() -> None:
    seen = cast_rays(unit_grid((4, 4)), (0.0, 0.0, 0.0), np.empty((0, 3)))
    assert (seen.cell.size, seen.state.size) == (0, 0)


def test_a_cell_needs_as_many_hits_as_asked_for() -> None:
    """A cell with fewer hits is free where a ray passed it, and not seen otherwise."""
    ends = [(1.5, 0.5, 0.0), (2.5, 0.5, 0.0), (2.5, 0.5, 0.0)]
    grid = unit_grid((4, 1))
    found = {k: as_states(grid, cast_rays(grid, (0.5, 0.5, 0.0), ends, min_hits=k)) for k in (1, 2, 3)}
    assert found[1] == {(0, 0, 0): 0, (1, 0, 0): 1, (2, 0, 0): 1}
    assert found[2] == {(0, 0, 0): 0, (1, 0, 0): 0, (2, 0, 0): 1}
    assert found[3] == {(0, 0, 0): 0, (1, 0, 0): 0}


@pytest.mark.parametrize(("hits", "state"), [(MAX_MIN_HITS - 1, 0), (MAX_MIN_HITS, 1), (1000, 1)])
def test_many_hits_are_counted_to_the_most_that_is_asked_for(hits: int, state: int) -> None:
    ends = [(1.5, 0.5, 0.0)] * hits + [(2.5, 0.5, 0.0)] * 300
    seen = cast_rays(unit_grid((4, 1)), (0.5, 0.5, 0.0), ends, min_hits=MAX_MIN_HITS)
    assert dict(zip(seen.cell.tolist(), seen.state.tolist(), strict=True)) == {0: 0, 1: state, 2: 1}


@pytest.mark.parametrize(
    ("origin", "options", "words"),
    [
        ((nan, 0.0, 0.0), {}, "origin"),
        ((0.0, inf, 0.0), {}, "origin"),
        ((0.0, 0.0, 0.0), {"max_range_m": 0.0}, "max_range"),
        ((0.0, 0.0, 0.0), {"max_range_m": -1.0}, "max_range"),
        ((0.0, 0.0, 0.0), {"max_range_m": nan}, "max_range"),
        ((0.0, 0.0, 0.0), {"min_hits": 0}, "min_hits"),
        ((0.0, 0.0, 0.0), {"min_hits": MAX_MIN_HITS + 1}, "min_hits"),
    ],
)
def test_what_makes_no_sense_is_refused(origin: Point, options: dict[str, float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        cast_rays(unit_grid((4, 4)), origin, [(1.0, 1.0, 0.0)], **options)  # type: ignore[arg-type]

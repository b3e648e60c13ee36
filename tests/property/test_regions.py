"""Regions against the plainest search there is, and grids against their definition."""

from itertools import combinations, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tidemap.space.grid import NEIGHBOURS, SINGLE, GridGeometry
from tidemap.space.regions import Spans, label_regions, link

Mark = tuple[int, int, int]
"""(sample, cell, state)."""
GRIDS = st.builds(
    lambda origin, resolution, shape: GridGeometry("map", tuple(origin), resolution, tuple(shape)),
    st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=3),
    st.sampled_from([0.05, 0.1, 0.2, 1.0, 7.3]),
    st.lists(st.integers(1, 5), min_size=1, max_size=3),
)
quick = settings(max_examples=80)


@st.composite
def marked(draw: st.DrawFn) -> tuple[GridGeometry, list[Mark]]:
    """A grid and distinct marks on it, few samples apart."""
    grid = draw(GRIDS)
    first = draw(st.sampled_from([-(10**12), -3, 0, 10**12]))
    locations = st.tuples(st.integers(first, first + 3), st.integers(0, grid.n_cells - 1))
    seen = draw(st.dictionaries(locations, st.integers(0, 1), min_size=1, max_size=40))
    marks = [(sample, cell, state) for (sample, cell), state in seen.items()]
    return grid, draw(st.permutations(marks))


def belong(grid: GridGeometry, one: Mark, other: Mark) -> bool:
    """The definition."""
    (t, a, _), (u, b, _) = one, other
    i, j = np.array(np.unravel_index([a, b], grid.shape3)).T
    return t == u and int(np.abs(i - j).max()) <= 1


def search(grid: GridGeometry, marks: list[Mark]) -> set[frozenset[Mark]]:
    """Groups, found by walking from mark to mark."""
    left, groups = set(marks), set()
    while left:
        group, edge = set(), {left.pop()}
        while edge:
            here = edge.pop()
            group.add(here)
            found = {other for other in left if belong(grid, here, other)}
            left -= found
            edge |= found
        groups.add(frozenset(group))
    return groups


def labelled(grid: GridGeometry, marks: list[Mark]) -> set[frozenset[Mark]]:
    sample, cell, _ = (np.array(column, np.int64) for column in zip(*marks, strict=True))
    label = label_regions(grid, sample, cell)
    assert label.shape == (len(marks),)
    return {frozenset(marks[i] for i in np.flatnonzero(label == each)) for each in np.unique(label)}


@quick
@given(marked())
def test_regions_are_the_groups_that_a_search_finds(case: tuple[GridGeometry, list[Mark]]) -> None:
    assert labelled(*case) == search(*case)


Span = tuple[int, int, frozenset[tuple[int, int]]]
"""First sample, last sample, and the (cell, state) that a group shows."""
SPANS = st.lists(
    st.tuples(
        st.integers(-20, 20),
        st.integers(0, 4),
        st.frozensets(st.tuples(st.integers(0, 3), st.integers(0, 1)), min_size=1, max_size=3),
    ).map(lambda each: (each[0], each[0] + each[1], each[2])),
    min_size=1,
    max_size=12,
)


def continues(one: Span, other: Span, gap: int, read: set[tuple[int, int]]) -> bool:
    """The definition."""
    (_, end, _), (begin, _, _) = sorted([one, other], key=lambda span: span[:2])
    between = range(end + 1, begin)
    return len(between) <= gap and any(all((cell, n) not in read for n in between) for cell, _ in one[2] & other[2])


def linked(spans: list[Span], gap: int, read: set[tuple[int, int]]) -> set[frozenset[int]]:
    rows = [(i, cell, state) for i, (_, _, parts) in enumerate(spans) for cell, state in parts]
    label, cell, state = (np.array(column, np.int64) for column in zip(*rows, strict=True))
    first, last = (np.array([span[end] for span in spans], np.int64) for end in (0, 1))

    def was_read(cells: np.ndarray, samples: np.ndarray) -> np.ndarray:
        return np.array([pair in read for pair in zip(cells.tolist(), samples.tolist(), strict=True)], np.bool_)

    number = link(Spans(label, cell, state.astype(np.uint8), first, last), gap, was_read)
    return {frozenset(np.flatnonzero(number == each).tolist()) for each in np.unique(number)}


def united(spans: list[Span], gap: int, read: set[tuple[int, int]]) -> set[frozenset[int]]:
    """Two after two, as long as two continue one another."""
    groups = [(frozenset([i]), span) for i, span in enumerate(spans)]
    while True:
        found = next(((a, b) for a, b in combinations(groups, 2) if continues(a[1], b[1], gap, read)), None)
        if found is None:
            return {members for members, _ in groups}
        a, b = found
        joined = (min(a[1][0], b[1][0]), max(a[1][1], b[1][1]), a[1][2] | b[1][2])
        groups = [each for each in groups if each not in found] + [(a[0] | b[0], joined)]


@quick
@given(SPANS, st.integers(0, 4), st.sets(st.tuples(st.integers(0, 3), st.integers(-20, 24)), max_size=12))
def test_what_continues_is_linked_whatever_the_order(spans: list[Span], gap: int, read: set[tuple[int, int]]) -> None:
    assert linked(spans, gap, read) == united(spans, gap, read)


def test_no_marks_no_regions() -> None:
    none = np.empty(0, np.int64)
    assert label_regions(SINGLE, none, none).tolist() == []


def test_a_region_does_not_go_round_the_edge() -> None:
    """The last cell of a row and the first of the next are neighbours in memory, not in space."""
    grid = GridGeometry("map", (0.0, 0.0, 0.0), 1.0, (3, 4, 5))
    left, right = grid.cell([[0, 0, 4], [0, 3, 0]])[:2].tolist()
    assert len(labelled(grid, [(0, left, 1), (0, left + 1, 1)])) == 2
    assert len(labelled(grid, [(0, right, 1), (0, right + 5, 1)])) == 2


def test_half_of_the_neighbours_and_their_opposites_are_all() -> None:
    opposites = {tuple(-step for step in each) for each in NEIGHBOURS}
    assert {*NEIGHBOURS, *opposites} == set(product((-1, 0, 1), repeat=3)) - {(0, 0, 0)}
    assert opposites.isdisjoint(NEIGHBOURS)


@quick
@given(GRIDS)
def test_index_and_cell_are_inverse(grid: GridGeometry) -> None:
    cells = np.arange(grid.n_cells)
    index = grid.index(cells)
    np.testing.assert_array_equal(grid.cell(index), cells)
    np.testing.assert_array_equal(index, np.array(list(np.ndindex(grid.shape3))))
    assert grid.n_cells == np.prod(grid.shape3)


@quick
@given(GRIDS, st.sampled_from([(-1, 0, 0), (0, -1, 0), (0, 0, -1), (9, 0, 0), (0, 9, 0), (0, 0, 9)]))
def test_what_is_outside_is_no_cell(grid: GridGeometry, index: tuple[int, int, int]) -> None:
    with pytest.raises(ValueError, match=r"out of bounds|invalid entry"):
        grid.cell([index])
    with pytest.raises(ValueError, match="out of bounds"):
        grid.index([grid.n_cells])


@quick
@given(GRIDS, st.data())
def test_a_bounding_box_is_the_least_that_holds_its_cells(grid: GridGeometry, data: st.DataObject) -> None:
    cells = np.array(data.draw(st.lists(st.integers(0, grid.n_cells - 1), min_size=1, max_size=6)))
    box = np.array(grid.bounding_box(cells))
    assert inside(grid, box, cells).all()
    low = np.array(grid.origin) + grid.index(cells) * grid.resolution_m
    np.testing.assert_allclose(box[:3], low.min(axis=0))
    np.testing.assert_allclose(box[3:], low.max(axis=0) + grid.resolution_m)
    shrunk = np.concatenate([box[:3] + 0.6 * grid.resolution_m, box[3:]])
    assert not inside(grid, shrunk, cells).all()


@quick
@given(GRIDS, st.data())
def test_inside_is_decided_by_the_centre(grid: GridGeometry, data: st.DataObject) -> None:
    cells = np.arange(grid.n_cells)
    corners = np.sort([data.draw(st.floats(-1e3, 1e3)) for _ in range(6)]).reshape(2, 3)
    centre = np.array(grid.origin) + (np.array(list(np.ndindex(grid.shape3))) + 0.5) * grid.resolution_m
    expected = [bool((corners[0] <= each).all() and (each <= corners[1]).all()) for each in centre]
    assert inside(grid, corners.ravel(), cells).tolist() == expected
    runs = grid.runs(tuple(corners.ravel()))
    listed = (runs.start[:, np.newaxis] + np.arange(runs.length)).ravel()
    assert listed.tolist() == np.flatnonzero(expected).tolist()
    for size in (1, 4, 7):
        assert runs.chunks(size).tolist() == np.unique(listed // size).tolist()


def inside(grid: GridGeometry, box: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Which cells, in any order, are in a box."""
    order = np.argsort(cells, kind="stable")
    found = np.zeros(len(cells), np.bool_)
    found[order[grid.runs(tuple(box)).among(cells[order])]] = True
    return found

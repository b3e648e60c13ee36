"""Which cells are shown in which colour."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tests.unit.web.states import NOW, map_view
from tidemap.services.map_view import MapView
from tidemap.space.grid import GridGeometry
from tidemap_web.viewer import colors
from tidemap_web.viewer.board import WHOLE, Board, Picture, Taste
from tidemap_web.viewer.layers import MIN_SWING
from tidemap_web.viewer.painting import BLOCK, RECOLOURED, RESHAPED, TILE

GRID = GridGeometry("map", (0.0, 0.0, 0.0), 0.5, (2, 3, 4))
OLD = NOW - 9999
LEFT, RIGHT = 0, 1
Rgb = colors.Rgb


def colored(board: Board, side: int) -> dict[int, Rgb]:
    """The colour of every cell that a grid shows."""
    rows = board.shown(side)
    return dict(zip(board.cell[rows].tolist(), map(tuple, board.colors(side, rows).tolist()), strict=True))


def painted(*view: Any, taste: Taste | None = None, **more: Any) -> tuple[Board, Picture]:
    shown = map_view(GRID, *view, **more)
    board = Board(GRID, shown)
    return board, board.paint(shown, shown.seen, taste or Taste(dim=False))


def of(probability: float) -> Rgb:
    red, green, blue = colors.of_probability(np.array([probability], np.float32))[0].tolist()
    return red, green, blue


def test_predicted_cells_have_the_colour_of_their_probability_above_the_floor() -> None:
    board, _ = painted({0: 1.0, 5: 0.5, 23: 0.02})
    assert colored(board, LEFT) == {0: of(1.0), 5: of(0.5)}
    assert board.points(board.shown(LEFT)).tolist() == [[0.5, 0.5, 0.5], [0.5, 1.5, 1.5]]


P = dict(enumerate([0.95, 0.05, 0.95, 0.05, 0.95, 0.5, 0.05]))
SEEN = {0: (1, NOW), 1: (1, NOW), 2: (0, NOW), 3: (0, NOW), 4: (1, OLD), 6: (1, OLD)}


def test_observed_cells_are_occupied_unexpected_missing_or_stale() -> None:
    board, picture = painted(P, SEEN)
    assert colored(board, RIGHT) == {
        0: colors.OCCUPIED,
        1: colors.UNEXPECTED,
        2: colors.MISSING,
        4: colors.STALE,
        6: colors.STALE,  # too long ago to be judged
    }
    assert (picture.unexpected, picture.missing, picture.stale) == (1, 1, 2)


def test_the_confidence_decides_what_is_marked() -> None:
    for confidence, unexpected in ((0.6, 1), (0.8, 0)):
        assert painted({0: 0.3}, {0: (1, NOW)}, confidence=confidence)[1].unexpected == unexpected


def test_what_is_always_occupied_is_grey_and_lighter_where_it_is_higher() -> None:
    usual = {0: 0.99, 5: 0.5, 23: 0.99}
    seen: Mapping[int, tuple[int, float]] = {0: (1, NOW), 5: (1, NOW), 23: (1, OLD)}
    board, picture = painted({0: 0.99, 5: 0.99, 23: 0.96}, seen, mean=usual, taste=Taste())
    low, high = colors.STRUCTURE
    assert colored(board, LEFT) == {0: low, 5: of(0.99), 23: high}
    assert colored(board, RIGHT) == {0: low, 5: colors.OCCUPIED, 23: high}
    assert (picture.structure, picture.stale) == (2, 0)


def test_structure_that_is_gone_is_marked() -> None:
    board, _ = painted({0: 0.99}, {0: (0, NOW)}, mean={0: 0.99}, taste=Taste())
    assert colored(board, RIGHT) == {0: colors.MISSING}


def test_without_sightings_nothing_is_observed() -> None:
    assert colored(painted({0: 1.0})[0], RIGHT) == {}


def test_a_crop_shows_the_cells_of_a_box() -> None:
    view = map_view(GRID, dict.fromkeys(range(GRID.n_cells), 1.0))
    board = Board(GRID, view)
    for crop, shown in (
        ((0, 0, 1, 9, 9, 2), [cell for cell in range(GRID.n_cells) if 1 <= cell % 4 <= 2]),
        ((1, 1, 0, 1, 1, 9), [16, 17, 18, 19]),
        (WHOLE, list(range(GRID.n_cells))),
    ):
        board.paint(view, view.seen, Taste(crop=crop))
        assert sorted(colored(board, LEFT)) == shown


def test_the_amplitude_of_the_day_is_shown_where_there_is_one_and_walls_stay_grey() -> None:
    view = map_view(GRID, {0: 0.99, 1: 0.5, 2: 0.5, 3: 0.5}, mean={0: 0.99})
    board = Board(GRID, view)
    swing = np.full(GRID.n_cells, np.nan, np.float32)
    swing[[0, 1, 2, 3]] = (0.0, 2 / np.pi, 1 / np.pi, MIN_SWING / 2)
    board.paint(view, view.seen, Taste(predicted="day", floor=0.9), swing)
    assert colored(board, LEFT) == {0: colors.STRUCTURE[0], 1: of(1.0), 2: of(0.5)}


def test_verdicts_are_three_and_entropy_is_highest_in_the_middle() -> None:
    p = {0: 0.95, 1: 0.5, 2: 0.05}
    verdicts = colored(painted(p, taste=Taste(floor=0.0, predicted="verdict"))[0], LEFT)
    assert verdicts == {0: of(1.0), 1: of(0.5), 2: of(0.1)}
    entropy = colored(painted(p, taste=Taste(floor=0.0, predicted="entropy"))[0], LEFT)
    assert entropy[1] == of(1.0)
    assert entropy[0] == pytest.approx(entropy[2], abs=3)


def test_ages_are_brightest_where_they_are_newest() -> None:
    seen = {0: (1, NOW), 1: (1, NOW - 7200), 2: (0, NOW - 90 * 86400)}
    board, _ = painted({0: 0.5, 1: 0.5, 2: 0.5}, seen, taste=Taste(observed="age"))
    found = colored(board, RIGHT)
    assert found[0] == of(1.0)
    assert found[2] == of(0.1)
    assert sum(found[0]) > sum(found[1]) > sum(found[2])


def test_an_overlay_puts_marks_over_the_prediction() -> None:
    board, _ = painted(P, SEEN, taste=Taste(dim=False, layout="overlay"))
    assert colored(board, LEFT) == {
        **{cell: of(P[cell]) for cell in (0, 4, 5)},
        1: colors.UNEXPECTED,
        2: colors.MISSING,
    }
    assert colored(board, RIGHT) == {}


def test_differences_are_of_what_was_seen_lately_and_otherwise() -> None:
    board, _ = painted(P, SEEN, taste=Taste(layout="difference"))
    found = colored(board, LEFT)
    assert sorted(found) == [1, 2]
    assert found[1] == pytest.approx(colors.UNEXPECTED, abs=12)
    assert found[2] == pytest.approx(colors.MISSING, abs=12)


def test_only_the_tiles_of_cells_that_have_changed_are_drawn_again() -> None:
    grid = GridGeometry("map", (0.0, 0.0, 0.0), 0.1, (TILE // 64, 64, 3))
    view = map_view(grid, dict.fromkeys(range(grid.n_cells), 0.5))
    board = Board(grid, view)
    assert (board.paint(view, view.seen, Taste()).changed[LEFT] == RESHAPED).all()
    assert not board.paint(view, view.seen, Taste()).changed.any()
    p = view.probability.copy()
    p[TILE + 1], p[2 * TILE + 1] = 0.6, 0.0
    view = replace(view, probability=p)
    assert board.paint(view, view.seen, Taste()).changed.tolist() == [[0, RECOLOURED, RESHAPED], [0, 0, 0]]


HALL = GridGeometry("map", (0.0, 0.0, 0.0), 0.1, (BLOCK // 32, 64, 2))
FRESH = Taste(fresh_s=90.0)
TASTES = (
    FRESH,
    replace(FRESH, dim=False),
    replace(FRESH, observed="age"),
    replace(FRESH, predicted="day"),
    replace(FRESH, fresh_s=600.0),
    replace(FRESH, layout="overlay"),
    replace(FRESH, crop=(0, 0, 0, 3, 9, 1)),
)
SWING = np.linspace(0, 0.4, HALL.n_cells).astype(np.float32)
CELL, STATE = st.sampled_from(range(0, HALL.n_cells, 97)), st.integers(0, 1)
MOVE = st.one_of(
    st.tuples(st.just("go to"), st.integers(-4, 4)),
    st.tuples(st.just("show"), st.sampled_from(TASTES)),
    st.tuples(st.just("read"), st.lists(st.tuples(CELL, STATE, st.integers(-4, 4)), min_size=1, max_size=3)),
    st.tuples(st.just("predict"), st.lists(st.tuples(CELL, st.sampled_from([0.0, 0.05, 0.5, 0.99])), max_size=3)),
)


def counted(picture: Picture) -> tuple[Any, ...]:
    """All that is counted."""
    return picture.shown, picture.unexpected, picture.missing, picture.stale, picture.structure


def moved(view: MapView, taste: Taste, step: str, what: Any) -> tuple[MapView, Taste]:
    """A view and a taste, after a step."""
    if step == "go to":
        return replace(view, time=NOW + 60 * what), taste
    if step == "show":
        return view, what
    cells = np.array([cell for cell, *_ in what], np.int64)
    if step == "predict":
        p = view.probability.copy()
        p[cells] = [at for _, at in what]
        return replace(view, probability=p), taste
    assert view.seen is not None
    state = np.array([state for _, state, _ in what], np.uint8)
    samples = view.location.base.sample(NOW + 60.0 * np.array([minute for *_, minute in what]))
    return replace(view, seen=view.seen.replaced(cells, state, np.asarray(samples))), taste


@example([("go to", 0), ("read", [(0, 1, -2)])])  # the same sample says something else
@given(st.lists(MOVE, min_size=1, max_size=12))
def test_what_is_painted_over_what_was_painted_is_what_is_painted_anew(moves: list[tuple[str, Any]]) -> None:
    seen = {cell: (cell % 2, NOW + 60 * (cell // BLOCK - 2)) for cell in range(0, HALL.n_cells, 97)}
    view, taste = map_view(HALL, dict.fromkeys(range(HALL.n_cells), 0.5), seen), FRESH
    board = Board(HALL, view)
    for step, what in moves:
        view, taste = moved(view, taste, step, what)
        before, fresh = board.codes.copy(), Board(HALL, view)
        picture = board.paint(view, view.seen, taste, SWING)
        anew = fresh.paint(view, view.seen, taste, SWING)
        assert (board.codes == fresh.codes).all()
        assert counted(picture) == counted(anew)
        assert picture.changed.any(axis=1).tolist() == (before != board.codes).any(axis=1).tolist()


def test_a_flat_grid_lies_on_the_ground() -> None:
    flat = GridGeometry("map", (0.0, 0.0, 0.0), 0.5, (2, 3))
    board = Board(flat, map_view(flat, {0: 0.5, 5: 0.5}))
    assert board.index.tolist() == [[0, 0, 0], [1, 2, 0]]

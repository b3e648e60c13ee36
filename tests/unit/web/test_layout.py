"""Where things stand, what the camera sees, and what a click hits."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from tidemap.space.grid import GridGeometry
from tidemap_web.viewer.layout import Bounds, Layout, arrange, camera_pose, floor_step
from tidemap_web.viewer.picking import Ray, first_hit, rotation
from tidemap_web.viewer.span import DAY_S, span

FOV = 0.7


def layout_of(shape: tuple[int, int, int], flat: bool = False, titles: tuple[str, ...] = ("one", "other")) -> Layout:
    index = np.array([[0, 0, 0], [n - 1 for n in shape]], dtype=np.int32)
    grid = GridGeometry("map", (3.0, -2.0, 0.5), 0.2, shape)
    return arrange(Bounds.of(grid, index), flat, titles)


def test_the_observed_grid_stands_aside_without_overlap() -> None:
    layout = layout_of((10, 20, 3))
    assert layout.low == pytest.approx([3.0, -2.0, 0.5])
    assert layout.high == pytest.approx([5.0, 2.0, 1.1])
    assert layout.shift[0] > layout.size[0]
    assert layout.grid.centre_at(np.array([[0, 0, 0]], dtype=np.int32))[0] == pytest.approx([3.1, -1.9, 0.6])


def test_one_grid_stands_alone() -> None:
    layout = layout_of((10, 20, 3), titles=("one",))
    assert not layout.beside
    assert layout.shift.tolist() == [0, 0, 0]


def test_the_edges_of_the_floor_say_metres_of_the_grids_frame() -> None:
    layout = layout_of((30, 50, 3))  # x from 3 to 9, y from -2 to 8 metres
    x, y = ([tick for tick in layout.ticks() if tick.name.startswith(axis)] for axis in "xy")
    assert [(tick.text, tick.at[0]) for tick in x] == [("4", 4.0), ("6", 6.0), ("x 8 m", 8.0)]
    assert [tick.text for tick in y] == ["-2", "0", "2", "4", "6", "y 8 m"]
    assert all(tick.at[0] < layout.low[0] for tick in y)


@given(st.tuples(*[st.integers(1, 60)] * 3), st.floats(0.4, 3.0), st.booleans())
def test_the_camera_sees_all_of_both_grids(shape: tuple[int, int, int], aspect: float, above: bool) -> None:
    layout = layout_of(shape)
    camera = camera_pose(layout, aspect, FOV, above)
    forward = (camera.look_at - camera.position) / np.linalg.norm(camera.look_at - camera.position)
    right = np.array([1.0, 0.0, 0.0])
    up = np.cross(right, forward)
    for corner in (layout.low, layout.high, layout.low + layout.shift, layout.high + layout.shift):
        ray = corner - camera.position
        depth = ray @ forward
        assert depth > 0
        assert abs(ray @ up) / depth <= np.tan(FOV / 2)
        assert abs(ray @ right) / depth <= np.tan(FOV / 2) * aspect


@pytest.mark.parametrize(("extent", "step"), [(0.5, 0.05), (6, 0.5), (11, 1), (13, 2), (100, 10), (1000, 100)])
def test_floor_lines_are_round(extent: float, step: float) -> None:
    assert floor_step(extent) == pytest.approx(step)


def test_the_nearest_square_under_the_pointer_is_picked() -> None:
    layout = layout_of((4, 4, 4))
    index = np.array([[0, 0, 0], [1, 0, 0], [1, 3, 0]], dtype=np.int32)
    centre = layout.grid.centre_at(index)
    for aim, hit in ((0, 0), (1, 1), (2, 1)):  # the third is right behind the second
        origin = centre[aim] - np.array([0.0, 5.0, 0.0])
        ray = Ray(origin, np.array([0.0, 1.0, 0.0]), SOUTHERN)
        found = first_hit(ray, centre, 0.08)
        assert found is not None
        assert found[0] == pytest.approx(centre[hit][1] - origin[1])
        assert found[1] == hit
    past = Ray(centre[0] + np.array([5.0, -5.0, 0.0]), np.array([0.0, 1.0, 0.0]), SOUTHERN)
    assert first_hit(past, centre, 0.08) is None


SOUTHERN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # right, down, forward as columns


@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_a_rotation_keeps_lengths_and_hands(q: list[float]) -> None:
    matrix: NDArray[np.float64] = rotation(np.array(q) / np.linalg.norm(q))
    assert matrix @ matrix.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(matrix) == pytest.approx(1)


def test_the_timeline_offers_a_day_or_a_fifth_of_the_future() -> None:
    day = DAY_S
    assert span(0, 2 * day, 2.5 * day).stop == 3.5 * day  # counted from now
    assert span(0, 100 * day, 100.5 * day).stop == 120.5 * day
    assert span(0, 10 * day, 1000 * day).stop == 12 * day  # an old recording: counted from its end

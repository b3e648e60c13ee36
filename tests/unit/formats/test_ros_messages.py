"""ROS messages of any origin: what is wrong with one is said in words. Right ones are in `tests/unit/importing`."""

from array import array
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tidemap.formats.ros_messages import finite_points, laser_points, occupancy_states, stamp


def header(frame: str = "map") -> Any:
    return SimpleNamespace(frame_id=frame, stamp=SimpleNamespace(sec=5, nanosec=250_000_000))


def laser(**changes: Any) -> Any:
    fields = {"angle_min": 0.0, "angle_increment": 1.0, "range_min": 0.1, "range_max": 5.0, "ranges": [1.0, 2.0]}
    return SimpleNamespace(header=header(), **(fields | changes))


def cloud(points: Any, order: str = "<", size: int = 4, **changes: Any) -> Any:
    """Points (height, width, 3), with an empty byte behind each and three behind each row."""
    height, width, _ = np.shape(points)
    kind = np.dtype([("x", f"{order}f{size}"), ("y", f"{order}f{size}"), ("z", f"{order}f{size}"), ("pad", "u1")])
    rows = np.zeros((height, width), kind)
    for axis, name in enumerate("xyz"):
        rows[name] = np.asarray(points)[..., axis]
    data = b"".join(row.tobytes() + b"\0\0\0" for row in rows)
    datatype = {4: 7, 8: 8}[size]
    named = [SimpleNamespace(name=name, offset=size * at, datatype=datatype) for at, name in enumerate("xyz")]
    fields = {
        "height": height,
        "width": width,
        "fields": named,
        "is_bigendian": order == ">",
        "point_step": kind.itemsize,
        "row_step": width * kind.itemsize + 3,
        "data": np.frombuffer(data, np.uint8),
    }
    return SimpleNamespace(header=header(), **(fields | changes))


def grid(data: Any, **changes: Any) -> Any:
    turn = SimpleNamespace(x=0.0, y=0.0, z=changes.pop("turn", 0.0), w=1.0)
    origin = SimpleNamespace(position=SimpleNamespace(x=1.0, y=2.0, z=0.0), orientation=turn)
    fields = {"width": 3, "height": 2, "resolution": np.float32(0.05), "origin": origin} | changes
    return SimpleNamespace(header=header("/map"), info=SimpleNamespace(**fields), data=data)


def test_a_stamp_is_exact_to_the_nanosecond_that_a_float_can_hold() -> None:
    assert stamp(header()) == 5.25


def test_infinity_is_twice_as_far_as_rays_clear_and_what_was_not_measured_is_left_out() -> None:
    measured = laser(ranges=[1.0, np.inf, 9.0, -np.inf, np.nan, 0.05, 0.0, 4.0], angle_increment=0.0)
    found = laser_points(measured)
    assert found.points[:, 0].tolist() == [1, 10, 4]
    assert (found.max_range_m, found.flat) == (5.0, True)
    assert laser_points(measured, 3.0).points[:, 0].tolist() == [1, 6, 4], "the last one clears up to 3 m"
    assert laser_points(laser(range_max=np.inf), 3.0).max_range_m == 3.0
    assert laser_points(laser(range_max=np.inf, ranges=[np.inf])).points.shape == (0, 3)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"range_max": 0.0}, "highest range"),
        ({"range_max": np.nan}, "highest range"),
        ({"angle_min": np.nan}, "angles"),
        ({"angle_increment": np.inf}, "angles"),
    ],
)
def test_a_wrong_laser_is_refused_in_words(changes: dict[str, float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        laser_points(laser(**changes))


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("size", [4, 8])
def test_clouds_of_any_order_size_and_padding(order: str, size: int) -> None:
    points = np.arange(1.0, 19.0).reshape(2, 3, 3)
    points[1, 1, 2] = np.nan
    found = finite_points(cloud(points, order, size)).points
    assert found.tolist() == [*points[0].tolist(), points[1, 0].tolist(), points[1, 2].tolist()]
    assert finite_points(cloud(np.empty((1, 0, 3)))).points.shape == (0, 3)
    assert finite_points(cloud(np.zeros((2, 3, 3)))).points.shape == (0, 3), "the sensor itself is no echo"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"data": np.zeros(5, np.uint8)}, "5 bytes, which is too few for 3 x 2"),
        ({"width": 10**6, "height": 10**6}, "at most"),
        ({"row_step": 0}, "too few"),
        ({"fields": []}, "no field x"),
        ({"fields": [SimpleNamespace(name="x", offset=0, datatype=2)]}, "no field x of float32"),
        ({"fields": [SimpleNamespace(name="x", offset=10**9, datatype=7)]}, "outside of a point"),
        ({"fields": [SimpleNamespace(name="x", offset=-4, datatype=7)]}, "outside of a point"),
    ],
)
def test_a_wrong_cloud_is_refused_in_words(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        finite_points(cloud(np.zeros((2, 3, 3)), **changes))


@settings(max_examples=60)
@given(st.lists(st.integers(-1, 100), min_size=6, max_size=6))
def test_rows_run_along_x(data: list[int]) -> None:
    found, state = occupancy_states(grid(np.array(data, np.int8)))
    assert (found.frame, found.origin, found.resolution_m, found.shape) == ("map", (1.0, 2.0, 0.0), 0.05, (3, 2))
    for x in range(3):
        for y in range(2):
            percent = data[y * 3 + x]
            expected = 1 if percent >= 65 else 0 if 0 <= percent <= 25 else 255
            assert state[found.cell([[x, y, 0]])[0]] == expected


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"width": 4}, "6 cells, but declares 4 x 2"),
        ({"width": 0, "height": 0}, "declares 0 x 0"),
        ({"resolution": 0.0}, "resolution is 0"),
        ({"resolution": np.nan}, "resolution is nan"),
        ({"turn": 0.1}, "yaw of 0"),
    ],
)
def test_a_wrong_grid_is_refused_in_words(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        occupancy_states(grid(np.zeros(6, np.int8), **changes))


@pytest.mark.parametrize("kind", [list, tuple, np.array, partial(array, "b"), partial(np.array, dtype=np.uint8)])
def test_cells_of_any_kind_of_array_are_read(kind: Any) -> None:
    data = [0, 25, 65, 100, 26, 0]
    _, state = occupancy_states(grid(kind(data)))
    assert state.reshape(3, 2).T.reshape(-1).tolist() == [0, 0, 1, 1, 255, 0]
    _, unknown = occupancy_states(grid(np.full(6, 255, np.uint8)))
    assert set(unknown.tolist()) == {255}, "-1 without a sign"


@pytest.mark.parametrize("value", [101, 200, -2, -128, 10**9, 2**70, 0.5, np.nan, "a", None, [1, 2]])
def test_cells_that_are_no_percentage_are_refused_in_words(value: Any) -> None:
    with pytest.raises(ValueError, match=r"percent|cells|inhomogeneous"):
        occupancy_states(grid([0, 0, 0, 0, 0, value]))

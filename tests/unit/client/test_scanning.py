"""Scans of the client: arrays and messages shaped as those of ROS, as the server reads them."""

import json
from types import SimpleNamespace as Shape
from typing import Any

import numpy as np
import pytest

from tests.support.messages import FLOAT64, laser_scan, occupancy_grid, point_cloud, stamp
from tidemap.api.scan_body import read_scan
from tidemap.client import ros
from tidemap.client.answers import State
from tidemap.client.posting import occupancy
from tidemap.client.scanning import ScanPost, scan
from tidemap.client.times import unix, unix_array
from tidemap.formats.scan_body import ScanBody
from tidemap.ingest.scan import SentScan
from tidemap.schemas.locations import Grid

POSE = [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0]
POINTS = np.random.default_rng(1).normal(size=(12, 3)).astype(np.float32)


def made(measured: Any, pose: Any = POSE, time: Any = 5.0, **said: Any) -> ScanPost:
    return scan("/locations/lab", measured, pose, time, source="spot", key=None, **said)


def sent(post: ScanPost) -> SentScan:
    """What the server reads of a post."""
    (batch,) = post.batches()
    request = batch.request()
    assert request.path == "/locations/lab/scans"
    assert request.query == {"source": "spot"}
    assert request.content is not None
    return read_scan(ScanBody(request.content, request.headers["Content-Type"]))


def test_arrays_arrive_as_they_are() -> None:
    covariance = np.eye(6) * 0.01
    read = sent(made(POINTS, covariance=covariance, max_range=9.0, min_hits=2, frame="map", registration="never"))
    np.testing.assert_array_equal(read.points, POINTS)
    header = read.header
    assert (header.time, header.map_from_sensor, header.max_range, header.min_hits) == (5.0, POSE, 9.0, 2)
    assert (header.frame, header.registration) == ("map", "never")
    np.testing.assert_array_equal(header.covariance, covariance)
    flat = sent(made(POINTS[:, :2].tolist()))
    assert flat.points is not None
    assert flat.points.shape == (12, 2)


@pytest.mark.parametrize("options", [{}, {"datatype": FLOAT64}, {"big": True}, {"rows": 3}, {"padding": 0}])
def test_point_clouds_are_their_points(options: Any) -> None:
    read = sent(made(point_cloud(POINTS, **options), time=None))
    np.testing.assert_array_equal(read.points, POINTS)
    assert read.header.time == 1_700_000_000.25


def test_a_cloud_that_is_none_is_refused() -> None:
    cloud = point_cloud(POINTS)
    cloud.data = cloud.data[:-40]
    with pytest.raises(ValueError, match="too few"):
        made(cloud)
    cloud.fields = cloud.fields[:3]
    with pytest.raises(ValueError, match="no field z of float32"):
        made(cloud)


def test_laser_scans_are_their_ranges() -> None:
    ranges = [1.0, np.inf, np.nan, 0.01]
    read = sent(made(laser_scan(ranges), time=None, max_range=6.0))
    np.testing.assert_array_equal(read.ranges, np.array(ranges, np.float32))
    header = read.header
    assert (header.angle_min, header.angle_increment, header.range_min, header.range_max) == (0.0, 0.5, 0.1, 8.0)
    assert (header.max_range, header.time) == (6.0, 1_700_000_000.25)
    assert sent(made(laser_scan(ranges, range_max=np.inf))).header.range_max is None


def test_the_same_scan_is_the_same_bytes_and_digest() -> None:
    first, again, other = (next(made(points).batches()) for points in (POINTS, POINTS.copy(), POINTS + 1))
    assert first.content == again.content
    digests = [ScanBody(batch.content, batch.content_type).digest for batch in (first, again, other)]
    assert digests[0] == digests[1] != digests[2]
    assert first.key != again.key
    moved = next(made(POINTS, time=6.0).batches())
    assert ScanBody(moved.content, moved.content_type).digest != digests[0]


@pytest.mark.parametrize(
    "pose",
    [
        POSE,
        np.array(POSE),
        Shape(translation=Shape(x=1.0, y=2.0, z=3.0), rotation=Shape(x=0.0, y=0.0, z=0.0, w=1.0)),
        Shape(position=Shape(x=1.0, y=2.0, z=3.0), orientation=Shape(x=0.0, y=0.0, z=0.0, w=1.0)),
        Shape(transform=Shape(translation=Shape(x=1.0, y=2.0, z=3.0), rotation=Shape(x=0.0, y=0.0, z=0.0, w=1.0))),
    ],
)
def test_poses_of_all_shapes(pose: Any) -> None:
    assert sent(made(POINTS, pose)).header.map_from_sensor == POSE


def test_a_matrix_stays_one() -> None:
    assert sent(made(POINTS, np.eye(4))).header.map_from_sensor == np.eye(4).tolist()


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"measured": np.ones(3)}, "shape"),
        ({"measured": np.ones((3, 4))}, "shape"),
        ({"measured": np.array([["a", "b"]])}, "type"),
        ({"pose": np.eye(3)}, "shape"),
        ({"time": None}, "time"),
        ({"max_range": np.nan}, "JSON"),
    ],
)
def test_what_is_no_scan_is_refused_before_it_is_sent(wrong: Any, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        next(made(wrong.pop("measured", POINTS), **wrong).batches())


def test_stamps_of_ros_are_times() -> None:
    assert unix(stamp()) == 1_700_000_000.25
    assert unix_array(stamp()).tolist() == [1_700_000_000.25]
    assert unix_array([stamp(), stamp(5, 0)]).tolist() == [1_700_000_000.25, 5.0]
    assert ros.Stamp.of(1_700_000_000.25) == ros.Stamp(1_700_000_000, 250_000_000)


def test_occupancy_grids_keep_their_layout() -> None:
    percent = np.array([[100, 0, -1], [50, 65, 25]], np.int8)
    for grid in (percent, occupancy_grid(percent)):
        (batch,) = occupancy("/locations/lab", 5.0, grid).batches()
        assert batch.query == {"time": 5.0, "layout": "ros"}
        assert batch.request().path == "/locations/lab/observations"
        assert batch.content.endswith(percent.tobytes())
    with pytest.raises(ValueError, match="rotated"):
        occupancy("/locations/lab", 5.0, occupancy_grid(percent, yaw=0.3))
    unsigned = occupancy("/locations/lab", 5.0, percent.astype(np.uint8))
    assert next(unsigned.batches()).content.endswith(percent.tobytes()), "255 is -1 without a sign"
    with pytest.raises(ValueError, match="percent"):
        occupancy("/locations/lab", 5.0, percent.astype(np.int16) + 10)
    with pytest.raises(ValueError, match="shape"):
        occupancy("/locations/lab", 5.0, percent[0])


def state(grid: Grid, cell: Any, probability: Any) -> State:
    cells = np.asarray(cell, np.int64)
    n, likely = len(cells), np.asarray(probability, np.float32)
    return State(
        time=12.5,
        as_of=12.5,
        given="model",
        confidence=0.65,
        estimator="static",
        order=0,
        revision=1,
        shape=tuple(grid.shape),
        cell=cells,
        probability=likely,
        state=np.zeros(n, np.int8),
        verdict=np.select([likely > 0.65, likely < 0.35], ["occupied", "free"], "uncertain"),
        unavailable=np.zeros((0, 2), np.int64),
        grid=grid,
    )


def test_a_state_as_an_occupancy_grid() -> None:
    grid = Grid(frame="floor", origin=(1.0, 2.0, 0.0), resolution_m=0.5, shape=[3, 2])
    found = state(grid, [0, 1, 5], [0.0, 0.254, 1.0]).to_occupancy_grid()
    assert found.data.reshape(found.info.height, found.info.width).tolist() == [[0, -1, -1], [25, -1, 100]]
    assert (found.info.width, found.info.height, found.info.resolution) == (3, 2, 0.5)
    assert (found.info.origin.position.x, found.info.origin.position.y, found.header.frame_id) == (1.0, 2.0, "floor")
    assert found.header.stamp == ros.Stamp(12, 500_000_000)
    (batch,) = occupancy("/locations/lab", found.header.stamp, found).batches()
    assert batch.query["time"] == 12.5


def test_a_band_of_layers_is_as_occupied_as_its_most_occupied_cell() -> None:
    grid = Grid(origin=(0.0, 0.0, 0.0), resolution_m=1.0, shape=[1, 2, 3])
    found = state(grid, [0, 1, 2, 5], [0.9, 0.2, 0.4, 0.7])
    assert found.to_occupancy_grid().data.tolist() == [90, 70]
    assert found.to_occupancy_grid(z_min=1.0).data.tolist() == [40, 70]
    assert found.to_occupancy_grid(z_min=1.0, z_max=2.0).data.tolist() == [20, -1]
    assert found.to_occupancy_grid(z_min=9.0).data.tolist() == [-1, -1]


def test_a_band_of_layers_is_free_where_all_that_are_known_are() -> None:
    grid = Grid(origin=(0.0, 0.0, 0.0), resolution_m=1.0, shape=[1, 3, 3])
    found = state(grid, [0, 1, 2, 5], [0.9, 0.2, 0.4, 0.7])
    assert found.to_occupancy_grid(mode="trinary").data.tolist() == [100, 100, -1]
    assert found.to_occupancy_grid(z_min=1.0, mode="trinary").data.tolist() == [-1, 100, -1]
    assert found.to_occupancy_grid(z_min=1.0, z_max=2.0, mode="trinary").data.tolist() == [0, -1, -1]
    assert state(grid, [0, 2], [0.1, 0.2]).to_occupancy_grid(mode="trinary").data.tolist() == [0, -1, -1]


def test_a_door_is_no_map() -> None:
    found = state(Grid(resolution_m=1.0, shape=[1, 2]), [0], [0.9])
    with pytest.raises(ValueError, match="no grid"):
        State(**{name: getattr(found, name) for name in State.__slots__ if name != "grid"}).to_occupancy_grid()


def test_what_is_said_is_json_without_more() -> None:
    (batch,) = made(POINTS).batches()
    header = ScanBody(batch.content, batch.content_type).parts.header
    assert json.loads(bytes(header)).keys() == {"time", "map_from_sensor"}

"""One meaning of a laser's ranges, however they come: sensor_msgs/LaserScan and REP 117."""

from math import inf, nan
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tidemap.errors import InvalidInputError
from tidemap.formats.ros_messages import laser_points
from tidemap.ingest.scan import SentScan, scan_of
from tidemap.schemas.scans import ScanHeader
from tidemap.space.grid import GridGeometry
from tidemap.space.ranges import RangeLimits, points_of_ranges
from tidemap.space.rays import cast_rays

HERE: list[Any] = [5.0, 5.0, 0.0, 0.0, 0.0, 0.0, 1.0]
GRID = GridGeometry("map", (0.0, 0.0, 0.0), 0.5, (20, 20))
LOW, HIGH, STEP = 0.25, 4.0, 0.1
RANGE = st.sampled_from([nan, inf, -inf, 0.0, -1.0, 0.125, LOW, 1.5, 2.0, 3.25, 3.875, 4.5, 1e30])


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        (RangeLimits(LOW, HIGH, HIGH), [2 * HIGH, LOW, 3.0, HIGH]),
        (RangeLimits(LOW, HIGH, 2.0), [4.0, LOW, 3.0, HIGH]),
        (RangeLimits(LOW, HIGH), [LOW, 3.0, HIGH]),
        (RangeLimits(clear=2.0), [4.0, 0.125, LOW, 3.0, HIGH, 5.0]),
        (RangeLimits(), [0.125, LOW, 3.0, HIGH, 5.0]),
    ],
)
def test_what_was_measured_is_a_point(limits: RangeLimits, expected: list[float]) -> None:
    ranges = np.array([nan, inf, -inf, 0.0, -1.0, 0.125, LOW, 3.0, HIGH, 5.0])
    found = points_of_ranges(ranges, np.zeros(len(ranges)), limits)
    assert found.tolist() == [[each, 0, 0] for each in expected]


@settings(max_examples=100)
@given(st.lists(RANGE, min_size=1, max_size=8), st.sampled_from([None, 1.0, 2.5, 9.0]))
def test_a_scan_that_is_posted_sees_the_cells_of_one_that_is_imported(
    ranges: list[float], max_range: float | None
) -> None:
    said: dict[str, Any] = {"angle_min": 0.3, "angle_increment": STEP, "range_min": LOW, "range_max": HIGH}
    imported = laser_points(SimpleNamespace(ranges=np.array(ranges, np.float32), **said), max_range or inf)
    origin = np.array(HERE[:3])
    truth = cast_rays(GRID, origin, imported.points + origin, max_range_m=imported.max_range_m)
    header = ScanHeader(time=0.0, map_from_sensor=HERE, max_range=max_range, **said)
    try:
        seen = scan_of(SentScan(header, ranges=np.array(ranges, np.float32)), GRID).cast(GRID)
    except InvalidInputError:
        assert not len(imported.points)
        return
    assert (seen.cell.tolist(), seen.state.tolist()) == (truth.cell.tolist(), truth.state.tolist())


@pytest.mark.parametrize("limit", [8.1, 8.2, 8.3])
@pytest.mark.parametrize("written", [float, np.float32], ids=["as it is meant", "as a float32"])
def test_a_range_at_a_limit_is_measured_in_every_direction(limit: float, written: Any) -> None:
    """Which neither the rounding of a float32 nor that of cosines decides."""
    grid = GridGeometry("map", (0.0, 0.0, 0.0), 0.05, (400, 400))
    pose: list[Any] = [10.013, 10.021, 0.0, 0.0, 0.0, 0.0, 1.0]
    ranges, high = np.full(720, limit, np.float32), float(written(limit))
    angles: dict[str, Any] = {"angle_min": 0.0, "angle_increment": np.pi / 360}
    whole = ScanHeader(time=0.0, map_from_sensor=pose, **angles)
    truth = scan_of(SentScan(whole, ranges=ranges), grid).cast(grid)
    for said in ({"range_max": high}, {"max_range": high}, {"range_min": high, "range_max": 9.0}):
        scan = scan_of(SentScan(whole.model_copy(update=said), ranges=ranges), grid)
        assert len(scan.returns) == 720, said
        seen = scan.cast(grid)
        assert (seen.cell.tolist(), seen.state.tolist()) == (truth.cell.tolist(), truth.state.tolist()), said
    imported = laser_points(SimpleNamespace(ranges=ranges, range_min=0.0, range_max=high, **angles))
    ends = imported.points + pose[:3]
    hit = cast_rays(grid, np.array(pose[:3]), ends, max_range_m=imported.max_range_m).state.sum()
    assert hit == truth.state.sum()

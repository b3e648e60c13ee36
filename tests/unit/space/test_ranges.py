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

"""What was sent to a scan: ranges as REP 117 has them, points, and what cannot be one."""

from typing import Any

import numpy as np
import pytest

from tidemap.errors import InvalidInputError
from tidemap.ingest.scan import SentScan, refuse_outside, scan_of
from tidemap.schemas.scans import ScanHeader
from tidemap.space.grid import GridGeometry

GRID = GridGeometry("map", (0.0, 0.0, 0.0), 0.5, (20, 20, 1))
HERE = [5.0, 5.0, 0.0, 0.0, 0.0, 0.0, 1.0]
NAN, INF = np.nan, np.inf


def header(**said: Any) -> ScanHeader:
    return ScanHeader(**{"time": 0.0, "map_from_sensor": HERE, **said})


def of_ranges(ranges: list[float], **said: Any) -> np.ndarray[Any, Any]:
    """Angle and distance (n, 2) of the points that ranges become."""
    scan = scan_of(SentScan(header(**said), ranges=np.array(ranges)), GRID)
    assert scan.flat
    assert not scan.points[:, 2].any()
    x, y = scan.points[:, 0], scan.points[:, 1]
    return np.stack([np.arctan2(y, x), np.hypot(x, y)], axis=1)


def test_ranges_become_points_at_their_angles() -> None:
    found = of_ranges([1.0, 2.0, 3.0], angle_min=-0.5, angle_increment=0.25)
    np.testing.assert_allclose(found, np.array([[-0.5, 1], [-0.25, 2], [0, 3]]), atol=1e-6)
    np.testing.assert_array_equal(found, of_ranges([1.0, 2.0, 3.0], angles=[-0.5, -0.25, 0.0]))


def test_infinity_clears_up_to_the_range_and_the_rest_is_left_out() -> None:
    said = {"angle_min": 0.0, "angle_increment": 0.1, "range_min": 0.2, "range_max": 8.0}
    found = of_ranges([NAN, INF, -INF, 0.1, 9.0, 4.0], **said)
    np.testing.assert_allclose(found[:, 0], [0.1, 0.5], atol=1e-6)
    assert found[0, 1] > 8
    assert found[1, 1] == pytest.approx(4)
    scan = scan_of(SentScan(header(**said, max_range=6.0), ranges=np.array([INF, 7.0])), GRID)
    assert scan.max_range_m == 6
    assert (scan.ranges > 6).all(), "both clear up to max_range, and hit nothing"
    assert len(scan.returns) == 0


def test_points_without_all_their_numbers_are_left_out() -> None:
    points = np.array([[1, 0, 0], [NAN, 1, 1], [1, INF, 0], [0, 0, 1e300], [0, 0, 0]])
    assert scan_of(SentScan(header(), points=points), GRID).points.tolist() == [[1, 0, 0]]


def refused(sent: SentScan, field: str, says: str) -> None:
    with pytest.raises(InvalidInputError) as caught:
        refuse_outside(scan_of(sent, GRID), GRID)
    assert caught.value.errors[0].field == field
    assert says in caught.value.errors[0].message


POINT = np.ones((1, 3))
ROOT = np.sqrt(0.5)


@pytest.mark.parametrize(
    ("sent", "field", "says"),
    [
        (SentScan(header(map_from_sensor=[0.0] * 7), POINT), "map_from_sensor", "no rotation"),
        (SentScan(header(map_from_sensor=[0.0] * 6 + [0.5]), POINT), "map_from_sensor", "norm 0.5"),
        (SentScan(header(map_from_sensor=[0.0] * 5), POINT), "map_from_sensor", "shape"),
        (SentScan(header(map_from_sensor=[[0.0] * 4] * 4), POINT), "map_from_sensor", "last row"),
        (SentScan(header(map_from_sensor=[[1.0], 2.0, 3.0, 4.0]), POINT), "map_from_sensor", "4x4"),
        (SentScan(header(frame="odom"), POINT), "frame", "'map'"),
        (SentScan(header(covariance=[[0.0] * 6] * 6), POINT), "covariance", "unknown"),
        (SentScan(header(covariance=[[1.0] * 5] * 6), POINT), "covariance", "six"),
        (SentScan(header(covariance=(-np.eye(6)).tolist()), POINT), "covariance", "negative"),
        (SentScan(header(covariance=np.tri(6).tolist()), POINT), "covariance", "symmetric"),
        (SentScan(header(), np.full((3, 3), NAN)), "points", "NaN"),
        (SentScan(header(), np.zeros((3, 3))), "points", "the sensor itself"),
        (SentScan(header(angles=[1.0], range_min=5.0, range_max=2.0), ranges=np.ones(1)), "range_min", "swap"),
        (SentScan(header(), POINT * 2, None), "map_from_sensor", ""),
        (SentScan(header(angles=[1.0]), POINT), "angles", "ranges"),
        (SentScan(header(), ranges=np.ones(3)), "angle_min", "need"),
        (SentScan(header(angles=[1.0]), ranges=np.ones(3)), "angles", "3 ranges"),
        (SentScan(header(angles=[1.0], angle_min=0.0), ranges=np.ones(1)), "angles", "either"),
        (SentScan(header(angles=[1.0]), ranges=np.array([INF])), "max_range", "clear"),
        (SentScan(header(angles=[1.0]), ranges=np.array([NAN])), "ranges", "NaN"),
    ],
)
def test_what_cannot_be_a_scan_is_refused_by_name(sent: SentScan, field: str, says: str) -> None:
    if not says:
        sent = SentScan(header(map_from_sensor=[900.0, *HERE[1:]]), sent.points)
        says = "outside of the grid"
    refused(sent, field, says)


def test_rounded_covariances_and_those_of_robots_that_stay_level_are_taken() -> None:
    level = np.diag([0.1, 0.1, 0, 0, 0, 0.01])
    level[0, 1], level[1, 0] = 0.02, 0.02 + 1e-12
    scan = scan_of(SentScan(header(covariance=level.tolist()), POINT), GRID)
    assert scan.covariance is not None
    assert np.array_equal(scan.covariance, scan.covariance.T)


def test_a_sensor_outside_that_looks_in_is_no_error() -> None:
    scan = scan_of(SentScan(header(map_from_sensor=[-1.0, *HERE[1:]]), np.array([[2.0, 0, 0]])), GRID)
    refuse_outside(scan, GRID)
    assert len(scan.cast(GRID).cell) == 3


def test_a_sensor_outside_that_looks_through_sees_what_is_free() -> None:
    """As through the open door of a room that has a small grid of its own."""
    through = scan_of(SentScan(header(map_from_sensor=[-1.0, *HERE[1:]]), np.array([[12.0, 0, 0]])), GRID)
    refuse_outside(through, GRID)
    seen = through.cast(GRID)
    assert (len(seen.cell), set(seen.state.tolist())) == (20, {0})
    past = scan_of(SentScan(header(map_from_sensor=[-1.0, -1.0, *HERE[2:]]), np.array([[12.0, 0, 0]])), GRID)
    with pytest.raises(InvalidInputError, match="no ray crosses it"):
        refuse_outside(past, GRID)

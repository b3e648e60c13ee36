"""What the robot's sensors measure in the areas that it visits."""

from datetime import datetime
from itertools import product
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from tidemap.demo import plan
from tidemap.demo.areas import AREAS, Area
from tidemap.demo.robot import INTERVAL_S
from tidemap.demo.sensors import CAMERA, LASER, Walker
from tidemap.demo.visits import SIGMA, SURVEY_SIGMA, Scanned, Visit, Visitor
from tidemap.demo.world import World
from tidemap.space.pose import Pose
from tidemap.space.rays import SeenCells
from tidemap.space.scan import Scan

MONDAY = datetime(2026, 3, 2, tzinfo=ZoneInfo("Europe/London")).timestamp()
NIGHT, MORNING = MONDAY + 2 * 3600, MONDAY + 8.5 * 3600
WORLD = World(5)


def visits(
    area: Area, start: float, number: int, surveyed_until: float = 0.0, every_s: float = INTERVAL_S
) -> list[Visit]:
    visitor = Visitor(WORLD, surveyed_until)
    found = (visitor.visit(area, start + every_s * i) for i in range(number))
    return [visit for visit in found if visit is not None]


def cast(area: Area, scanned: Scanned) -> SeenCells:
    """What a scan says from the true pose."""
    scan = Scan(scanned.points, scanned.true, max_range_m=scanned.sensor.max_range_m, flat=scanned.sensor.flat)
    return scan.cast(area.floor_grid if scanned.sensor.flat else area.grid)


@pytest.mark.parametrize("area", AREAS, ids=lambda area: area.name)
def test_a_cell_is_occupied_where_it_touches_what_stands_in_the_plan(area: Area) -> None:
    occupancy, chance = WORLD.occupancy(MORNING), np.random.default_rng(1)
    for cell in chance.choice(area.grid.n_cells, 300, replace=False):
        centre = area.grid.centre([cell])[0]
        corners = np.array([centre + 0.04 * np.array(step) for step in product((-1, 1), repeat=3)])
        index = np.floor(corners / plan.RESOLUTION_M).astype(int)
        inside = ((index >= 0) & (index < plan.SHAPE)).all(axis=1)
        assert area.truth(occupancy)[cell] == occupancy[tuple(index[inside].T)].any()
    layer = area.truth(occupancy).reshape(area.grid.shape)[:, :, 3]
    np.testing.assert_array_equal(
        area.floor_truth(occupancy), layer.ravel(), "the third layer is inside of the laser's"
    )


@pytest.mark.parametrize("area", AREAS, ids=lambda area: area.name)
def test_at_night_what_is_hit_is_there_and_most_of_what_is_passed_is_free(area: Area) -> None:
    (visit, *_) = visits(area, NIGHT, 3)
    occupancy = WORLD.occupancy(visit.time)
    for scanned, truth in ((visit.camera, area.truth(occupancy)), (visit.laser, area.floor_truth(occupancy))):
        seen = cast(area, scanned)
        right = truth[seen.cell] == (seen.state == 1)
        assert right[seen.state == 1].mean() > 0.995
        assert right[seen.state == 0].mean() > 0.93, "of a cell that a surface runs through rays pass the free half"


def test_a_visit_is_the_same_in_any_order_and_another_in_another_world() -> None:
    (first, *_) = visits(AREAS[0], MORNING, 3)
    other = Visitor(WORLD)
    other.visit(AREAS[1], MORNING)
    again = other.visit(AREAS[0], first.time)
    assert again is not None
    np.testing.assert_array_equal(again.camera.points, first.camera.points)
    assert again.laser.stated.values == first.laser.stated.values
    elsewhere = Visitor(World(6)).visit(AREAS[0], first.time)
    assert elsewhere is None or elsewhere.camera.stated.values != first.camera.stated.values


def test_poses_are_as_wrong_as_their_covariance_says() -> None:
    errors = []
    for visit in visits(AREAS[0], NIGHT, 60):
        for scanned in (visit.camera, visit.laser):
            shift = scanned.stated.translation - scanned.true.translation
            rotation = Pose(scanned.stated.rotation @ scanned.true.rotation.T, np.zeros(3)).rotation_vector
            errors.append(np.concatenate([shift, rotation]))
            np.testing.assert_allclose(np.diag(scanned.covariance), SIGMA**2)
    camera, laser = np.array(errors[::2]) / SIGMA, np.array(errors[1::2]) / SIGMA
    assert np.abs(np.sqrt((camera**2).mean(axis=0)) - 1).max() < 0.35
    assert not laser[:, 2:5].round(9).any(), "it stands level"
    (surveyed,) = visits(AREAS[0], NIGHT, 1, surveyed_until=NIGHT + 1)
    np.testing.assert_allclose(np.diag(surveyed.camera.covariance), SURVEY_SIGMA**2)


def upright(points: np.ndarray, at: np.ndarray) -> int:
    """How many points are around a position, above the floor and no higher than a person."""
    near = np.linalg.norm(points[:, :2] - at, axis=1) < 0.22
    return int((near & (points[:, 2] > 0.3) & (points[:, 2] < 1.8)).sum())


def test_somebody_who_walks_through_hides_what_is_behind() -> None:
    pose, occupancy = Pose(np.eye(3), np.array([1.7, 5.6, 1.1])), WORLD.occupancy(NIGHT)
    path = np.full((len(CAMERA.frames), 2), (2.7, 5.6))
    alone = CAMERA.sweep(occupancy, pose, [], np.random.default_rng(3))
    crossed = CAMERA.sweep(occupancy, pose, [Walker(path)], np.random.default_rng(3))
    assert upright(pose.apply(crossed), path[0]) > 300
    assert upright(pose.apply(alone), path[0]) == 0
    away = CAMERA.sweep(occupancy, pose, [Walker(path * np.nan)], np.random.default_rng(3))
    np.testing.assert_array_equal(away, alone)


def test_ranges_have_their_noise_and_some_are_lost() -> None:
    pose, occupancy = Pose(np.eye(3), np.array([1.7, 5.6, 0.3])), WORLD.occupancy(NIGHT)
    scans = [LASER.sweep(occupancy, pose, [], np.random.default_rng(i)) for i in range(20)]
    lost = 1 - np.array([len(scan) for scan in scans]) / (len(LASER.rays) * len(LASER.frames))
    assert 0 < np.median(lost) < 0.03
    wall = np.concatenate([scan[np.abs(scan[:, 1]) < 0.02] for scan in scans])
    left = wall[(wall[:, 0] < 0) & (wall[:, 0] > -4)][:, 0]
    assert left.std() == pytest.approx(LASER.noise_m, rel=0.4)


def test_people_are_seen_where_they_sit_and_where_they_walk() -> None:
    west = visits(AREAS[0], MONDAY, 96, every_s=900.0)
    seated = np.array([not WORLD.taken(visit.time).isdisjoint(AREAS[0].seats) for visit in west])
    person = np.array([visit.person for visit in west])
    assert person[seated].mean() > 0.9
    assert person[~seated].mean() < 0.1
    corridor = visits(AREAS[2], MONDAY, 96, every_s=900.0)
    hour = np.array([(visit.time - MONDAY) / 3600 for visit in corridor])
    walks = np.array([visit.person for visit in corridor])
    assert walks[(hour >= 8) & (hour < 9.5)].mean() > 0.6
    assert walks[hour < 7].mean() < 0.1
    assert 0.9 < len(west) / 96 < 1, "some visits are missed"

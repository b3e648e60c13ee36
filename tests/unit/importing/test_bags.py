"""Bags of all kinds import to exactly the cells that their arrays say; what is wrong with one is said in words."""

import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.bags import BOOL, CLOUD, KINDS, LASER, MAP, ODOMETRY, START, TEXT, bag, turned
from tests.unit.importing.robot import (
    FIRST,
    FLAT,
    GRID_DATA,
    MOUNT,
    MOUNT_YAW,
    OPEN,
    ROOM,
    SCANS,
    STEP,
    ranges,
    robot_at,
    seen_by_cloud,
    seen_by_laser,
    snapshots,
    written,
)
from tidemap.errors import UnusableFileError
from tidemap.importing.options import ImportOptions
from tidemap.importing.run import Report, survey_files
from tidemap.progress import Silent


@pytest.fixture(scope="module", params=KINDS)
def recorded(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("bag"), request.param)


def report(path: Path, **options: Any) -> Report:
    return survey_files([path], ImportOptions(**options), Silent())


@pytest.mark.parametrize("grid", [FLAT, ROOM], ids=["flat", "room"])
def test_a_laser_gives_the_cells_of_its_arrays(recorded: Path, grid: Any) -> None:
    found = list(snapshots(recorded, grid, topics=(LASER,)))
    assert [snapshot.time[0] for snapshot in found] == list(SCANS)
    for number, snapshot in enumerate(found):
        truth = seen_by_laser(grid, number)
        assert snapshot.cell is not None
        assert (snapshot.cell.tolist(), snapshot.state.tolist()) == (truth.cell.tolist(), truth.state.tolist())
        assert {0, 1} <= set(snapshot.state.tolist())


def test_a_cloud_gives_the_cells_of_its_arrays(recorded: Path) -> None:
    for number, snapshot in enumerate(snapshots(recorded, ROOM, topics=(CLOUD,))):
        truth = seen_by_cloud(ROOM, number)
        assert snapshot.cell is not None
        assert (snapshot.cell.tolist(), snapshot.state.tolist()) == (truth.cell.tolist(), truth.state.tolist())


def test_rays_are_cut_off_at_the_range_that_is_asked_for(recorded: Path) -> None:
    snapshot = next(snapshots(recorded, FLAT, topics=(LASER,), max_range_m=2.0))
    truth = seen_by_laser(FLAT, 0, 2.0)
    assert snapshot.cell is not None
    assert (snapshot.cell.tolist(), snapshot.state.tolist()) == (truth.cell.tolist(), truth.state.tolist())


def test_a_door_gives_its_states(recorded: Path) -> None:
    for topic in (BOOL, TEXT):
        found = list(snapshots(recorded, topics=(topic,), occupied=frozenset({"ajar"})))
        assert [(snapshot.time.tolist(), snapshot.state.tolist()) for snapshot in found] == [
            ([time], [int(is_open)]) for time, is_open in OPEN.items()
        ]
    with pytest.raises(UnusableFileError, match="'ajar' is neither occupied nor free; name what is occupied with"):
        report(recorded, topics=(TEXT,))


def test_an_occupancy_grid_is_not_transposed(recorded: Path) -> None:
    (snapshot,) = snapshots(recorded, FLAT, topics=(MAP,))
    assert snapshot.cell is not None
    x, y = FLAT.index(snapshot.cell)[:, 0] - 28, FLAT.index(snapshot.cell)[:, 1] - 28
    found = dict(zip(zip(x.tolist(), y.tolist(), strict=True), snapshot.state.tolist(), strict=True))
    known = {(x, y): value for (y, x), value in np.ndenumerate(GRID_DATA) if value in (0, 25, 65, 100)}
    assert found == {where: int(value >= 65) for where, value in known.items()}


def test_poses_can_come_from_odometry(recorded: Path, tmp_path: Path) -> None:
    del recorded
    with bag(tmp_path, "mcap") as (path, writer):
        writer.transform(START, "base_link", "sensor", MOUNT, turned(MOUNT_YAW), "/tf_static")
        for second in range(5):
            writer.odometry(START + second, "odom", "base_link", robot_at(START + second), turned(-0.5))
        writer.laser(SCANS[0], "sensor", ranges(0), FIRST, STEP)
    snapshot = next(snapshots(path, FLAT, fixed_frame="odom", pose_topics=(ODOMETRY,), topics=(LASER,)))
    assert snapshot.cell is not None
    assert snapshot.cell.tolist() == seen_by_laser(FLAT, 0).cell.tolist()


def test_the_survey_says_what_is_there_and_proposes_a_location(recorded: Path) -> None:
    found = report(recorded, occupied=frozenset({"ajar"}))
    assert {each.what for each in found.found} == {
        f"{LASER} (sensor_msgs/msg/LaserScan)",
        f"{CLOUD} (sensor_msgs/msg/PointCloud2)",
        f"{BOOL} (std_msgs/msg/Bool)",
        f"{TEXT} (std_msgs/msg/String)",
        f"{MAP} (nav_msgs/msg/OccupancyGrid)",
    }
    laser = report(recorded, topics=(LASER,))
    assert not laser.problems
    (scans,) = laser.found
    assert (scans.records, scans.missing, scans.first, scans.last) == (3, 0, SCANS[0], SCANS[2])
    assert laser.proposal is not None
    assert laser.proposal["kind"] == "grid2d"
    grid = laser.proposal["grid"]
    low, high = np.array(grid["origin"][:2]), np.array(grid["origin"][:2]) + np.array(grid["shape"]) * 0.05
    assert (low <= scans.low[:2]).all()
    assert (low + 0.05 >= scans.low[:2] - 1e-6).all()
    assert (high > scans.high[:2] - 1e-6).all()
    assert (high - 0.05 <= scans.high[:2] + 1e-6).all()
    door = report(recorded, topics=(BOOL,), interval_s=5.0, time_zone="Europe/London")
    assert door.proposal == {"kind": "state", "interval_s": 5.0, "time_zone": "Europe/London"}
    room = report(recorded, topics=(LASER, CLOUD))
    assert room.proposal is not None
    assert room.proposal["kind"] == "grid3d"
    exact = report(recorded, topics=(MAP,))
    assert exact.proposal is not None
    assert exact.proposal["grid"] == {"frame": "map", "origin": [1.0, 2.0, 0.0], "resolution_m": 0.25, "shape": [4, 3]}


def test_several_topics_are_a_choice(recorded: Path) -> None:
    found = report(recorded, occupied=frozenset({"ajar"}))
    assert found.proposal is None
    assert any("Choose some with --topic" in problem for problem in found.problems)
    assert any("one after the other" in problem for problem in found.problems)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"topics": ("/nothing",)}, r"no topic '/nothing'\. Its topics are .*/scan \(sensor_msgs/msg/LaserScan\)"),
        ({"topics": (ODOMETRY,)}, "no topic to import"),
        ({"topics": (LASER,), "pose_topics": ("/pose",)}, "no topic '/pose'"),
        (
            {"topics": (LASER,), "pose_topics": (CLOUD,)},
            "/points is sensor_msgs/msg/PointCloud2; poses come from one of",
        ),
        ({"topics": (LASER,), "pose_topics": (ODOMETRY,)}, "two parents"),
    ],
)
def test_a_wrong_topic_is_refused_in_words(recorded: Path, options: dict[str, Any], words: str) -> None:
    with pytest.raises(UnusableFileError, match=words):
        report(recorded, **options)


@pytest.mark.parametrize("kind", KINDS)
def test_a_missing_transform_is_a_problem_in_words(tmp_path: Path, kind: str) -> None:
    found = report(written(tmp_path, kind, until=2.0), topics=(LASER,))
    (problem,) = found.problems
    assert "2 of 3 cannot be used: the transform from 'base_link' to 'map' is known from" in problem
    assert "--skip-missing" in problem
    assert not report(found.sources[0].path, topics=(LASER,), skip_missing=True).problems
    none = report(found.sources[0].path, topics=(LASER,), fixed_frame="world")
    assert "no transform leads from the frame 'sensor' to 'world'" in none.problems[0]
    assert "--fixed-frame" in none.problems[0]


@pytest.mark.parametrize(
    ("move", "rotation", "words"),
    [
        ([np.nan, 0.0, 0.0], turned(0.0), "a transform of /tf is wrong: .*NaN"),
        ([0.0, 0.0, 0.0], (0.0, 0.0, 0.0, 0.0), "a transform of /tf is wrong: .*no rotation"),
        ([0.0, 0.0, 0.0], (0.0, 0.0, 0.0, 2.0), "a transform of /tf is wrong: .*norm 2"),
    ],
)
def test_a_transform_that_is_none_is_refused_in_words(
    tmp_path: Path, move: list[float], rotation: Any, words: str
) -> None:
    with bag(tmp_path, "mcap") as (path, writer):
        writer.transform(START, "map", "sensor", np.array(move), rotation)
        writer.laser(START, "sensor", ranges(0), FIRST, STEP)
    with pytest.raises(UnusableFileError, match=words):
        report(path, topics=(LASER,))


def test_scans_of_mixed_frames_are_a_problem_in_words(tmp_path: Path) -> None:
    with bag(tmp_path, "mcap") as (path, writer):
        writer.transform(START, "map", "sensor", MOUNT, turned(MOUNT_YAW), "/tf_static")
        for frame in ("sensor", "elsewhere"):
            writer.laser(START, frame, ranges(0), FIRST, STEP)
    (problem,) = report(path, topics=(LASER,)).problems
    assert "1 of 2 cannot be used: no transform leads from the frame 'elsewhere' to 'map'" in problem


def test_a_map_in_another_frame_or_turned_is_a_problem_in_words(tmp_path: Path) -> None:
    with bag(tmp_path, "db3") as (path, writer):
        writer.occupancy(START, "other", GRID_DATA, 0.25, np.zeros(3), turned(0.0))
    assert "in the frame 'other'" in report(path).problems[0]
    assert not report(path, fixed_frame="other").problems
    shutil.rmtree(path)
    with bag(tmp_path, "db3") as (path, writer):
        writer.occupancy(START, "map", GRID_DATA, 0.25, np.zeros(3), turned(0.1))
    with pytest.raises(UnusableFileError, match="yaw of 0"):
        report(path)


def test_a_bag_without_what_can_be_imported_lists_its_topics(tmp_path: Path) -> None:
    with bag(tmp_path, "mcap") as (path, writer):
        writer.odometry(START, "odom", "base_link", np.zeros(3), turned(0.0))
    with pytest.raises(UnusableFileError, match=r"Its topics are /odom \(nav_msgs/msg/Odometry\)"):
        report(path)


def files_of(path: Path) -> Iterator[Path]:
    yield from [path] if path.is_file() else sorted(path.iterdir())


@pytest.mark.parametrize("share", [0.0, 0.3, 0.6, 0.85])
def test_a_truncated_bag_is_refused_in_words(recorded: Path, tmp_path: Path, share: float) -> None:
    copy = tmp_path / recorded.name
    (shutil.copytree if recorded.is_dir() else shutil.copy)(recorded, copy)
    largest = max(files_of(copy), key=lambda each: each.stat().st_size)
    content = largest.read_bytes()
    largest.write_bytes(content[: int(share * len(content))])
    with pytest.raises(UnusableFileError, match="This bag cannot be read") as refused:
        report(copy, topics=(CLOUD,))
    assert str(copy) in str(refused.value)


@settings(max_examples=25)
@given(data=st.data())
def test_a_damaged_bag_is_read_or_refused_in_words(
    recorded: Path, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    copy = tmp_path_factory.mktemp("damaged") / recorded.name
    (shutil.copytree if recorded.is_dir() else shutil.copy)(recorded, copy)
    for file in files_of(copy):
        spoilt = bytearray(file.read_bytes())
        for _ in range(data.draw(st.integers(0, 8))):
            spoilt[data.draw(st.integers(0, len(spoilt) - 1))] = data.draw(st.integers(0, 255))
        file.write_bytes(bytes(spoilt))
    with suppress(UnusableFileError):  # any other error fails
        report(copy, topics=(LASER, CLOUD))
    shutil.rmtree(copy) if copy.is_dir() else copy.unlink()


def test_a_file_of_another_kind_with_the_name_of_a_bag(tmp_path: Path) -> None:
    for suffix in (".bag", ".db3", ".mcap"):
        file = tmp_path / f"x{suffix}"
        file.write_bytes(b"SQLite format 3\0" + bytes(100))
        with pytest.raises(UnusableFileError, match="This bag cannot be read"):
            report(file)
    sqlite3.connect(tmp_path / "empty.db3").close()
    with pytest.raises(UnusableFileError, match="This bag cannot be read"):
        report(tmp_path / "empty.db3")

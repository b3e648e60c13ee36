"""Tables, logs, maps and clouds become the observations that they hold; what is wrong is said in words."""

import gzip
import math
import os
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.slow_rays import rounded_path
from tests.unit.formats.clouds import pcd, rows
from tests.unit.importing.robot import snapshots
from tests.unit.spectral.real import needed
from tidemap.errors import UnusableFileError
from tidemap.formats import nav2, octomap, ply
from tidemap.formats.npy import UNSEEN
from tidemap.importing.options import ImportOptions
from tidemap.importing.run import Report, survey_files
from tidemap.importing.snapshots import resampled
from tidemap.progress import Silent
from tidemap.space.grid import GridGeometry
from tidemap.space.pose import Pose
from tidemap.space.rays import cast_rays

FLAT = GridGeometry("map", (0.0, 0.0, 0.0), 0.5, (4, 3))


def report(path: Path, **options: Any) -> Report:
    return survey_files([path], ImportOptions(**options), Silent())


def refused(path: Path, words: str, **options: Any) -> None:
    with pytest.raises(UnusableFileError, match=words) as error:
        report(path, **options)
    assert str(path) in str(error.value)


class TestTables:
    @pytest.mark.parametrize("mark", [",", ";", "\t"])
    def test_columns_are_read_by_name(self, tmp_path: Path, mark: str) -> None:
        file = tmp_path / "door.csv"
        lines = [("note", "when", "door"), ("a", "1700000000.5", "open"), ("", "2023-11-14T22:13:21Z", " Closed ")]
        file.write_text("\n".join(mark.join(line) for line in lines) + "\n")
        (snapshot,) = snapshots(file, time_column="when", state_column="door")
        assert (snapshot.time.tolist(), snapshot.state.tolist(), snapshot.cell) == (
            [1700000000.5, 1700000001.0],
            [1, 0],
            None,
        )
        (snapshot,) = snapshots(file, time_column="when", state_column="note", occupied=frozenset({"a"}), start=10.0)
        assert (snapshot.time.tolist(), snapshot.state.tolist()) == ([1700000010.5, 1700000011.0], [1, 0])

    def test_a_table_of_a_data_frame_is_read(self, tmp_path: Path) -> None:
        """With quotes around names and texts, and floats because a state is missing."""
        file = tmp_path / "door.csv"
        file.write_text('"when, UTC","door"\n"1700000000.0","1.0"\n1700000001.0,\n1700000002.0,0.0\n')
        (snapshot,) = snapshots(file, time_column="when, UTC", state_column="door")
        np.testing.assert_array_equal(snapshot.state, [1, np.nan, 0])

    def test_the_real_door(self) -> None:
        path = needed("office", "day_1.csv.gz")
        (snapshot,) = snapshots(path, time_column="time_s")
        plain = np.loadtxt(gzip.decompress(path.read_bytes()).decode().splitlines(), delimiter=",", skiprows=1)
        assert np.array_equal(snapshot.time, plain[:, 0])
        assert np.array_equal(snapshot.state, plain[:, 1])

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("", "no column 'time'"),
            ("time\n1\n", "no column 'state'.*its columns are 'time'"),
            ("time,time,state\n1,2,1\n", "no column 'time', or several"),
            ("time,state\n1\n", "line 2 has 1 fields"),
            ("time,state\n1,1\n\n2,0,0\n", "line 4 has 3 fields"),
            ("time,state\n1,ajar\n", "row 1: 'ajar' is neither occupied nor free.*--occupied"),
            ("time,state\nnoon,1\n", "row 1 has the time 'noon'"),
            ("time,state\n2026-01-01T00:00:00,1\n", "no time zone"),
            ("time,state\nnan,1\n", "row 1 has the time"),
            ("time,state\n1e300,1\n", "row 1 has the time"),
            ("time,state\n", "nothing in it to import"),
        ],
    )
    def test_a_wrong_table_is_refused_in_words(self, tmp_path: Path, text: str, words: str) -> None:
        file = tmp_path / "door.csv"
        file.write_text(text)
        if words.startswith("nothing"):
            assert words in report(file).problems[0]
        else:
            refused(file, words)

    def test_what_is_no_text_is_refused_in_words(self, tmp_path: Path) -> None:
        file = tmp_path / "door.csv"
        file.write_bytes(b"time,state\n\xff,1\n")
        refused(file, "no UTF-8")
        packed = tmp_path / "door.csv.gz"
        packed.write_bytes(gzip.compress(b"time,state\n1,1\n" * 100)[:-9])
        refused(packed, "damaged gzip")


def laser_line(ranges: list[float], pose: tuple[float, float, float], time: float, kind: str = "FLASER") -> str:
    numbers = [*ranges, *pose, *pose, time]
    return f"{kind} {len(ranges)} {' '.join(map(str, numbers))} host {time}\n"


class TestLogs:
    def test_angles_count_from_the_right(self, tmp_path: Path) -> None:
        file = tmp_path / "drive.log"
        text = "# comment\nPARAM a b\nODOM 0 0 0 0 0 0 1 host 1\n"
        text += laser_line([1.0] * 181, (1.0, 1.0, math.pi / 2), 5.0) + laser_line([81.83, 0.5], (1.0, 1.0, 0.0), 6.0)
        file.write_text(text)
        grid = GridGeometry("map", (-1.0, -1.0, 0.0), 0.5, (8, 8))
        first, second = snapshots(file, grid, start=100.0)
        assert (first.time[0], second.time[0]) == (105.0, 106.0)
        angle = np.deg2rad(np.arange(181))  # to the right of a robot that snapshots along y is x
        ends = np.stack([1 + np.cos(angle), 1 + np.sin(angle), 0 * angle], axis=1)
        truth = cast_rays(grid, [1, 1, 0], ends)
        assert first.cell is not None
        assert second.cell is not None
        assert first.cell.tolist() == truth.cell.tolist()
        # Two ranges are at -90° and 0°: the first is no echo, the second ends half a metre ahead.
        assert grid.index(second.cell[second.state == 1]).tolist() == [[5, 4, 0]]

    @pytest.mark.parametrize("name", ["intel", "freiburg-101"])
    def test_the_cells_of_real_logs_are_those_of_the_slow_truth(self, name: str) -> None:
        """Every tenth scan; `test_real_rays` has all of them."""
        path = needed("carmen2d", f"{name}-corrected.log.gz")
        lines = [line.split() for line in gzip.decompress(path.read_bytes()).decode().splitlines()]
        lasers = [fields for fields in lines if fields and fields[0] == "FLASER"]
        proposal = report(path, resolution_m=0.1).proposal
        assert proposal is not None
        form = proposal["grid"]
        grid = GridGeometry("map", tuple(form["origin"]), form["resolution_m"], tuple(form["shape"]))
        found = list(snapshots(path, grid, max_range_m=20.0))
        assert len(found) == len(lasers) > 200
        for fields, snapshot in list(zip(lasers, found, strict=True))[::10]:
            assert snapshot.cell is not None
            occupied, free = (set(snapshot.cell[snapshot.state == state].tolist()) for state in (1, 0))
            hit, passed, perhaps = slow_scan(fields, grid, 20.0)
            assert snapshot.time[0] == float(fields[-3])
            assert occupied == hit
            assert passed - hit <= free <= (passed | perhaps) - hit

    @pytest.mark.parametrize(
        ("line", "words"),
        [
            ("FLASER\n", "line 2: its number of ranges"),
            ("FLASER x 1\n", "line 2: its number of ranges"),
            ("FLASER 3 1 2 3\n", "line 2: it has 4 words, but one with 3 ranges has 13"),
            ("FLASER 1 x 0 0 0 0 0 0 1 host 1\n", "where numbers belong"),
            ("FLASER 1 1 nan 0 0 0 0 0 1 host 1\n", "NaN or infinite"),
            ("FLASER 99999999 1\n", "its number of ranges"),
        ],
    )
    def test_a_wrong_line_is_refused_in_words(self, tmp_path: Path, line: str, words: str) -> None:
        file = tmp_path / "drive.log"
        file.write_text("ODOM 1\n" + line)
        refused(file, words)


def slow_scan(fields: list[str], grid: GridGeometry, most: float) -> tuple[set[int], set[int], set[int]]:
    """Cells hit, surely passed, and perhaps passed, of a line of a log with 180 or 360 ranges."""
    n = int(fields[1])
    x, y, theta = map(float, fields[2 + n : 5 + n])
    hit: set[int] = set()
    cells: tuple[list[Any], list[Any]] = ([], [])
    start = (np.array([x, y, 0.0]) - grid.origin) / grid.resolution_m + (0, 0, 0.5)
    for number, text in enumerate(fields[2 : 2 + n]):
        length = float(text)
        if length >= 80:
            continue
        angle = theta - math.pi / 2 + number * math.pi / n
        reach = min(length, most)
        stop = start + np.array([math.cos(angle), math.sin(angle), 0]) * reach / grid.resolution_m
        last = np.floor(stop).astype(int)
        sure, sliver = rounded_path(start, stop)
        inside = [each[((each >= 0) & (each < grid.shape3)).all(axis=1)] for each in (sure, sliver)]
        cells[0].append(inside[0][(inside[0] != last).any(axis=1)])
        cells[1].append(inside[1])
        if length <= most and ((last >= 0) & (last < grid.shape3)).all():
            hit |= set(grid.cell([last]).tolist())
    passed, perhaps = (set(grid.cell(np.concatenate(each)).tolist()) for each in cells)
    return hit, passed, perhaps


class TestMaps:
    def test_a_map_is_one_observation(self, tmp_path: Path) -> None:
        plan = nav2.FloorPlan(FLAT, np.array([1, 0, UNSEEN] * 4, np.uint8))
        file = tmp_path / "map.zip"
        file.write_bytes(nav2.write(plan))
        os.utime(file, (1000.0, 1000.0))
        (snapshot,) = snapshots(file, FLAT)
        assert set(snapshot.time.tolist()) == {1000.0}
        assert snapshot.cell is not None
        assert snapshot.cell.tolist() == [0, 1, 3, 4, 6, 7, 9, 10]
        assert snapshot.state.tolist() == [1, 0] * 4
        assert report(file, time=7.0).found[0].first == 7.0
        graded = tmp_path / "graded.zip.gz"
        graded.write_bytes(gzip.compress(nav2.write_graded(FLAT, np.array([1, 0, np.nan] * 4, np.float32))))
        (again,) = snapshots(graded, FLAT)
        assert again.cell is not None
        assert (again.cell.tolist(), again.state.tolist()) == (snapshot.cell.tolist(), snapshot.state.tolist())

    def test_the_real_map(self) -> None:
        path = needed("nav2_map", "y4_aaf-cropped.yaml")
        proposal = report(path).proposal
        assert proposal is not None
        assert proposal["grid"]["shape"] == [1101, 2853]
        grid = GridGeometry("map", tuple(proposal["grid"]["origin"]), 0.05, (1101, 2853))
        (snapshot,) = snapshots(path, grid)
        assert [int((snapshot.state == state).sum()) for state in (0, 1)] == [652_623, 47_832]

    def test_the_real_tree(self) -> None:
        path = needed("octomap", "geb079.bt")
        proposal = report(path).proposal
        assert proposal is not None
        grid = GridGeometry("map", tuple(proposal["grid"]["origin"]), 0.08, tuple(proposal["grid"]["shape"]))
        (snapshot,) = snapshots(path, grid)
        tree = octomap.read(path.read_bytes())
        cells = tree.edge**3
        assert [int((snapshot.state == state).sum()) for state in (0, 1)] == [
            int(cells[tree.log_odds < 0].sum()),
            int(cells[tree.log_odds >= 0].sum()),
        ]

    def test_a_map_without_its_picture_is_refused_in_words(self, tmp_path: Path) -> None:
        file = tmp_path / "map.yaml"
        file.write_text("image: elsewhere/map.pgm\n")
        refused(file, "there is no .*map.pgm, which its YAML names")
        file.write_text("resolution: 1\n")
        refused(file, "names no image")
        file.write_text("image: [1, 2]\nfoo: [")
        refused(file, "names no image")

    def test_a_tree_that_is_too_wide_is_refused_in_words(self, tmp_path: Path) -> None:
        file = tmp_path / "map.bt"
        file.write_bytes(octomap.write_binary(0.1, np.array([[0, 0, 0], [65_535] * 3]), np.ones(2, np.bool_)))
        refused(file, "65536 x 65536 x 65536 cells")
        file.write_bytes(octomap.write_binary(0.1, np.empty((0, 3), np.int64), np.ones(0, np.bool_)))
        refused(file, "no leaves")

    @settings(max_examples=60)
    @given(st.data())
    def test_a_map_with_smaller_cells_is_occupied_where_one_of_them_is(self, data: st.DataObject) -> None:
        low = data.draw(st.tuples(st.floats(-1, 1), st.floats(-1, 1)))
        fine = GridGeometry("map", (*low, 0.0), data.draw(st.sampled_from([0.1, 0.25, 0.5])), (9, 7))
        states = st.lists(st.sampled_from([0, 1, UNSEEN]), min_size=63, max_size=63)
        state = np.array(data.draw(states), np.uint8)
        seen = resampled(fine, state, FLAT)
        truth: dict[int, int] = {}
        for cell in range(63):
            x, y, _ = fine.centre([cell])[0]
            i, j = math.floor(x / 0.5), math.floor(y / 0.5)
            if state[cell] != UNSEEN and 0 <= i < 4 and 0 <= j < 3:
                truth[i * 3 + j] = max(truth.get(i * 3 + j, 0), int(state[cell]))
        assert dict(zip(seen.cell.tolist(), seen.state.tolist(), strict=True)) == truth


POINTS = np.array([[1.0, 0.0, 0.1], [0.0, 1.0, 0.2], [np.nan, 0.0, 0.0]], np.float32)
POSES = "file,time,x,y,z,qx,qy,qz,qw\na.pcd,10,0.5,0.5,0.5,0,0,0,1\nb.ply,11,1,1,0.5,0,0,1,0\n"
ROOM = GridGeometry("map", (-1.0, -1.0, 0.0), 0.5, (8, 8, 4))


def folder_of_clouds(folder: Path) -> Path:
    (folder / "a.pcd").write_bytes(pcd(rows(POINTS), "binary_compressed"))
    (folder / "b.ply").write_bytes(ply.write(POINTS[:2].astype(np.float64), np.ones(2, np.float32)))
    (folder / "poses.csv").write_text(POSES)
    return folder


class TestClouds:
    def test_a_folder_is_a_sweep_a_file(self, tmp_path: Path) -> None:
        found = list(snapshots(folder_of_clouds(tmp_path), ROOM, start=1000.0))
        assert [snapshot.time[0] for snapshot in found] == [1010.0, 1011.0]
        for snapshot, pose in zip(found, ([0.5, 0.5, 0.5, 0, 0, 0, 1], [1, 1, 0.5, 0, 0, 1, 0]), strict=True):
            map_from_sensor = Pose.of(pose)
            truth = cast_rays(ROOM, map_from_sensor.translation, map_from_sensor.apply(POINTS[:2]))
            assert snapshot.cell is not None
            assert (snapshot.cell.tolist(), snapshot.state.tolist()) == (truth.cell.tolist(), truth.state.tolist())

    def test_a_cloud_without_a_pose_is_a_problem(self, tmp_path: Path) -> None:
        folder = folder_of_clouds(tmp_path)
        (folder / "c.pcd.gz").write_bytes(gzip.compress(pcd(rows(POINTS), "ascii")))
        assert "c.pcd.gz has no row in poses.csv" in report(folder).problems[0]
        assert not report(folder, skip_missing=True).problems
        other = tmp_path / "other.txt"
        (folder / "poses.csv").rename(other)
        refused(folder, "There is no .*poses.csv. Write one with the columns file, time, x, y, z, qx, qy, qz, qw")
        assert report(folder, poses=other).found[0].records == 2

    @pytest.mark.parametrize(
        ("change", "words"),
        [
            (("b.ply", "d.ply"), "'d.ply', which is no cloud of this folder"),
            (("b.ply", "a.pcd"), "names a file twice"),
            (("0,0,1,0", "0,0,0,0"), "the pose of 'b.ply': The quaternion is"),
            (("0,0,1,0", "0,0,2,0"), "Normalise"),
            (("0.5,0.5,0.5", "0.5,x,0.5"), "'y' has what is no number"),
            (("0.5,0.5,0.5", "0.5,nan,0.5"), "'y' has NaN"),
            (("qw", "w"), "no column 'qw'"),
        ],
    )
    def test_a_wrong_table_of_poses_is_refused_in_words(
        self, tmp_path: Path, change: tuple[str, str], words: str
    ) -> None:
        folder = folder_of_clouds(tmp_path)
        (folder / "poses.csv").write_text(POSES.replace(*change))
        refused(folder, words)

    @pytest.mark.parametrize("name", ["a.pcd", "b.ply"])
    def test_a_truncated_cloud_is_refused_in_words(self, tmp_path: Path, name: str) -> None:
        file = folder_of_clouds(tmp_path) / name
        file.write_bytes(file.read_bytes()[:-3])
        with pytest.raises(UnusableFileError, match=r"Send the whole file|cannot be read") as error:
            report(tmp_path)
        assert name in str(error.value)


def test_what_is_of_no_kind_is_refused_in_words(tmp_path: Path) -> None:
    refused(tmp_path / "nothing.bag", "no such file")
    (tmp_path / "x.graph").write_bytes(b"")
    refused(tmp_path / "x.graph", "of no kind that is read: bags")
    refused(tmp_path, "of no kind that is read")


FUZZED = {
    "door.csv": b"time,state\n1,1\n2,0\n",
    "drive.log": laser_line([1.0, 2.0], (0.0, 0.0, 0.0), 1.0).encode(),
    "map.zip": nav2.write(nav2.FloorPlan(FLAT, np.zeros(12, np.uint8))),
    "map.bt": octomap.write_binary(0.5, np.array([[32768] * 3]), np.ones(1, np.bool_)),
}


@settings(max_examples=120)
@given(name=st.sampled_from(sorted(FUZZED)), data=st.data())
def test_a_damaged_file_is_read_or_refused_in_words(
    name: str, data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Any other error, and any warning, fails."""
    spoilt = bytearray(FUZZED[name])
    for _ in range(data.draw(st.integers(0, 6))):
        spoilt[data.draw(st.integers(0, len(spoilt) - 1))] = data.draw(st.integers(0, 255))
    file = tmp_path_factory.mktemp("fuzz") / name
    file.write_bytes(bytes(spoilt[: data.draw(st.integers(0, len(spoilt)))]))
    with suppress(UnusableFileError):
        report(file)

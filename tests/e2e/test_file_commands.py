"""`tidemap import` and `tidemap export` against a real server: what goes in comes out, once, or not at all."""

import gzip
import io
import json
import zipfile
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
import yaml

from tests.support.bags import BOOL, CLOUD, LASER, START
from tests.support.here import Done, command
from tests.support.server import ServerProcess, StartServer
from tests.unit.importing.robot import OPEN, ROOM, SCANS, seen_by_cloud, seen_by_laser, written
from tests.unit.spectral.real import needed
from tidemap import Client
from tidemap.client import LocationHandle, TidemapError
from tidemap.client.answers import UNKNOWN
from tidemap.formats import octomap
from tidemap.space.grid import GridGeometry

NUMBERS = count(1)


@pytest.fixture
def client(shared_server: ServerProcess) -> Iterator[Client]:
    with Client(shared_server.url) as client:
        yield client


@pytest.fixture
def name() -> str:
    return f"imported-{next(NUMBERS)}"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("bag"), "mcap")


def run(client: Client, *words: object) -> Done:
    return command(*map(str, words), "--url", client._connection.server.base.removesuffix("/api/v1"))


def done(client: Client, *words: object) -> Any:
    """The JSON of a command that went well."""
    ended = run(client, *words, "--json")
    assert ended.returncode == 0, ended.stderr
    return json.loads(ended.stdout)


def states(client: Client, name: str, time: float) -> Any:
    """What was seen last of each cell, (n_cells,), -1 where nothing was."""
    with np.load(io.BytesIO(client.location(name).export("npz", time, source="observed").content)) as arrays:
        return arrays["state"].reshape(-1)


def names(client: Client) -> set[str]:
    return {each.name for each in client.locations()}


def test_a_dry_run_needs_no_server_and_says_what_is_there(recorded: Path) -> None:
    ended = command("import", str(recorded), "--dry-run", "--topic", LASER, "--url", "http://127.0.0.1:9", "--json")
    assert ended.returncode == 0
    said = json.loads(ended.stdout)
    (found,) = said["found"]
    assert (found["records"], found["missing"], found["times"]) == (
        3,
        0,
        ["2026-01-01T00:00:00.500000Z", "2026-01-01T00:00:03Z"],
    )
    assert (said["proposal"]["kind"], said["problems"]) == ("grid2d", [])
    plain = command("import", str(recorded), "--dry-run", "--topic", LASER)
    assert "3 records" in plain.stdout
    assert 'Location: {"name": null, "kind": "grid2d"' in plain.stdout
    assert "Reading: done after" in plain.stderr
    several = command("import", str(recorded), "--dry-run", "--topic", LASER, "--topic", BOOL)
    assert several.returncode == 1
    assert "Problem: some of this is for a grid" in several.stdout


def test_a_bag_is_stored_cell_for_cell(client: Client, name: str, recorded: Path) -> None:
    grid = {"origin": ROOM.origin, "resolution_m": ROOM.resolution_m, "shape": ROOM.shape}
    client.create_location(name, kind="grid3d", interval_s=0.25, grid=grid)
    tally = done(client, "import", recorded, "--location", name, "--topic", CLOUD)
    expected = np.full(ROOM.n_cells, UNKNOWN)
    stored = 0
    for number, time in enumerate(SCANS):
        seen = seen_by_cloud(ROOM, number)
        expected[seen.cell] = seen.state
        stored += len(seen.cell)
        assert states(client, name, time).tolist() == expected.tolist()
    assert (tally["stored"], tally["known"]) == (stored, 0)
    again = done(client, "import", recorded, "--location", name, "--topic", CLOUD)
    assert (again["stored"], again["known"]) == (0, stored)
    assert client.location(name).get().observations == stored


def test_a_location_is_made_from_what_is_found(client: Client, name: str, recorded: Path) -> None:
    words = ("import", recorded, "--location", name, "--topic", LASER, "--create", "--interval", 0.25)
    ended = run(client, *words, "--resolution", 0.25, "--time-zone", "Europe/London")
    assert ended.returncode == 0, ended.stderr
    assert f"{name}: " in ended.stdout
    made = client.location(name).get()
    assert (made.kind, made.interval_s, made.time_zone) == ("grid2d", 0.25, "Europe/London")
    assert made.grid is not None
    grid = GridGeometry("map", made.grid.origin, 0.25, tuple(made.grid.shape))
    seen = seen_by_laser(grid, 0)
    found = states(client, name, SCANS[0])
    assert np.flatnonzero(found != UNKNOWN).tolist() == seen.cell.tolist()
    assert found[seen.cell].tolist() == seen.state.tolist()
    assert run(client, *words).returncode == 0


def test_a_run_that_was_broken_off_goes_on(client: Client, name: str, recorded: Path) -> None:
    words = ("import", recorded, "--location", name, "--topic", LASER, "--create", "--resolution", 0.25)
    observe, left = LocationHandle.observe, iter(range(3))

    def broken(handle: Any, *args: Any, **kwargs: Any) -> Any:
        if next(left, None) is None:
            raise TidemapError(503, "Busy", "The server stopped.")
        return observe.__get__(handle, type(handle))(*args, **kwargs)

    with patch("tidemap.importing.posting.MEASUREMENTS_PER_POST", 100):
        with patch.object(LocationHandle, "observe", broken):
            first = run(client, *words)
        assert (first.returncode, first.stdout) == (1, "")
        assert "The server stopped" in first.stderr
        before = client.location(name).get().observations
        assert 0 < before <= 300
        second = done(client, *words)
    assert second["known"] == before
    assert client.location(name).get().observations == before + second["stored"]
    assert second["posts"] > 3


def test_a_door_of_a_bag_and_of_a_table(client: Client, name: str, recorded: Path, tmp_path: Path) -> None:
    tally = done(client, "import", recorded, "--location", name, "--topic", BOOL, "--create", "--interval", 1)
    assert tally["stored"] == len(OPEN)
    file = tmp_path / "door.csv"
    file.write_text("time,state\n1,open\n2,closed\n")
    start = START + 100
    assert done(client, "import", file, "--location", name, "--start", start)["stored"] == 2
    series = client.location(name).series(start=START, stop=START + 110, step=1)
    assert np.flatnonzero(series.observed >= 0).tolist() == [1, 2, 7, 101, 102]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--topic", LASER), "--create makes it"),
        (("--topic", "/nothing", "--create"), "Its topics are"),
        (("--topic", LASER, "--fixed-frame", "world", "--create"), "no transform leads from the frame 'sensor'"),
        (("--create",), "Choose some with --topic"),
    ],
)
def test_what_cannot_be_imported_stores_nothing(
    client: Client, name: str, recorded: Path, words: tuple[str, ...], says: str
) -> None:
    before = names(client)
    ended = run(client, "import", recorded, "--location", name, "--occupied", "ajar", *words)
    assert (ended.returncode, ended.stdout) == (1, "")
    assert says in ended.stderr
    assert names(client) == before


def test_a_truncated_file_stores_nothing_of_the_others(
    client: Client, name: str, recorded: Path, tmp_path: Path
) -> None:
    file = tmp_path / "map.bt"
    file.write_bytes(octomap.write_binary(0.5, np.array([[32768] * 3]), np.ones(1, np.bool_))[:-1])
    before = names(client)
    ended = run(client, "import", recorded, file, "--topic", CLOUD, "--location", name, "--create")
    assert ended.returncode == 1
    assert f"{file}: This OctoMap file cannot be read: its tree ends within a node" in ended.stderr
    assert names(client) == before


def test_what_does_not_fit_the_location_stores_nothing(
    client: Client, name: str, recorded: Path, tmp_path: Path
) -> None:
    client.create_location(name, interval_s=60)
    flat = client.create_location(
        f"{name}-flat", kind="grid2d", interval_s=60, grid={"frame": "floor", "resolution_m": 0.25, "shape": [4, 4]}
    )
    fine = client.create_location(
        f"{name}-fine", kind="grid3d", interval_s=60, grid={"resolution_m": 0.1, "shape": [4, 4, 4]}
    )
    far_away = {"origin": [100.0, 0.0, 0.0], "resolution_m": 0.5, "shape": [4, 4]}
    far = client.create_location(f"{name}-far", kind="grid2d", interval_s=60, grid=far_away)
    tree = tmp_path / "map.bt"
    tree.write_bytes(octomap.write_binary(0.5, np.array([[32768] * 3]), np.ones(1, np.bool_)))
    for location, file, more, says in (
        (name, recorded, ("--topic", LASER), "name a location with a grid"),
        (flat.name, recorded, ("--topic", BOOL), "name a location of kind 'state'"),
        (flat.name, recorded, ("--topic", LASER), "--fixed-frame floor"),
        (fine.name, tree, (), "cells of 0.5 m, larger than those of the location, 0.1 m"),
        (far.name, recorded, ("--topic", LASER), "nothing of it is inside. Check the frames"),
    ):
        ended = run(client, "import", file, "--location", location, *more)
        assert ended.returncode == 1
        assert says in ended.stderr
        assert client.location(location).get().observations == 0


def test_times_of_a_recording_need_its_start(server: StartServer, name: str, tmp_path: Path) -> None:
    file = tmp_path / "door.csv"
    file.write_text("time,state\n1,open\n2,closed\n")
    with Client(server(env={"TIDEMAP_PAST_S": "600000000"}).url) as client:
        ended = run(client, "import", file, "--location", name, "--create")
        assert ended.returncode == 1
        assert "say with --start" in ended.stderr
        assert client.location(name).get().observations == 0


def test_wrong_usage_is_two(client: Client, recorded: Path) -> None:
    for words in (
        ("import", recorded),
        ("import", "--location", "x"),
        ("import", recorded, "--location", "x", "--time", "now"),
        ("import", recorded, "--location", "x", "--max-range", "-1"),
        ("import", recorded, "--location", "x", "--max-range", "far"),
        ("import", recorded, "--location", "x", "--min-hits", "0"),
        ("import", recorded, "--location", "x", "--min-hits", "1.5"),
        ("export", "x", "--format", "bag"),
        ("export", "x"),
    ):
        assert run(client, *words).returncode == 2
    for wrong in (("--url", "ftp://x"), ("--key", "tm_\n")):
        ended = command("export", "x", "--format", "npz", *wrong)
        assert (ended.returncode, ended.stdout) == (2, "")
        assert ended.stderr.startswith("tidemap: ")


@pytest.mark.slow
def test_the_real_map_comes_out_as_it_went_in(client: Client, name: str, tmp_path: Path) -> None:
    described = needed("nav2_map", "y4_aaf-cropped.yaml")
    image = gzip.decompress(needed("nav2_map", "y4_aaf-cropped.pgm.gz").read_bytes())
    done(client, "import", described, "--location", name, "--create", "--time", START)
    asked = ("export", name, "--format", "nav2", "--source", "observed", "--time", START)
    file = tmp_path / "map.zip"
    assert done(client, *asked, "-o", file)["bytes"] == file.stat().st_size
    with zipfile.ZipFile(file) as archive:
        assert archive.read("map.pgm").split(b"255\n", 1)[1] == image.split(b"255\n", 1)[1]
        values = yaml.safe_load(archive.read("map.yaml"))
    assert values == yaml.safe_load(described.read_text()) | {"image": "map.pgm", "mode": "trinary"}
    there = run(client, *asked, "-o", file)
    assert there.returncode == 1
    assert "--overwrite" in there.stderr
    assert run(client, *asked, "-o", file, "--overwrite").returncode == 0


@pytest.mark.slow
def test_the_real_tree_comes_out_as_it_went_in(client: Client, name: str, tmp_path: Path) -> None:
    path = needed("octomap", "geb079.bt")
    done(client, "import", path, "--location", name, "--create", "--time", START)
    ended = run(client, "export", name, "--format", "octomap", "--source", "observed", "-o", tmp_path)
    assert ended.returncode == 0, ended.stderr
    one, other = (octomap.read(each.read_bytes()) for each in (path, tmp_path / f"{name}.bt"))
    assert np.array_equal(one.code, other.code)
    assert np.array_equal(one.depth, other.depth)
    assert np.array_equal(one.log_odds >= 0, other.log_odds >= 0)


def test_an_export_that_is_refused_writes_nothing(client: Client, name: str, tmp_path: Path) -> None:
    ended = run(client, "export", name, "--format", "ply", "-o", tmp_path / "map.ply")
    assert ended.returncode == 1
    assert "Location not found" in ended.stderr
    assert not list(tmp_path.iterdir())

"""GET /locations/{name}/export: the map at a moment as files that other programs read."""

import io
import zipfile
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pyarrow as pa
import pytest
import trimesh
import yaml
from PIL import Image

from tests.api.house import DAY, HOUR, NOW, Api, done, problem
from tidemap.formats import nav2, octomap, pcd, ply
from tidemap.formats.npy import UNSEEN
from tidemap.history.history import FREE, OCCUPIED

NOON = NOW + 12.5 * HOUR
GRID = {"frame": "map", "origin": [-1.0, 2.0, 0.0], "resolution_m": 0.5, "shape": [3, 2, 3]}
FORMATS = ("nav2", "octomap", "ply", "pcd", "npz", "arrow")


def exported(api: Api, name: str, **query: Any) -> httpx.Response:
    answer = api.get(f"/locations/{name}/export", params={"time": NOON, **query})
    assert answer.status_code == 200, answer.text
    return answer


def plan(answer: httpx.Response) -> list[list[int]]:
    """Columns (nx, ny) of a map of map_server."""
    found = nav2.read(answer.content)
    return [list(map(int, row)) for row in found.state.reshape(found.grid.shape)]


@pytest.fixture(scope="module")
def room(api: Api) -> str:
    """18 cells without a model. By [i, j]: a table with nothing over it, a shelf, an open door, nothing known."""
    name = api.location(kind="grid3d", grid=GRID)
    occupied = [[0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 1, 2]]
    free = [[0, 0, 1], [0, 0, 2], [1, 0, 0], [1, 0, 2], [2, 0, 1]]
    api.look(name, (NOW - DAY, occupied, free))
    api.look(name, (NOW - HOUR, [[2, 0, 1]], []))
    return name


def test_a_predicted_map_needs_a_model_and_an_observed_one_none(api: Api, room: str) -> None:
    problem(api.get(f"/locations/{room}/export?format=nav2"), 409, "no-model")
    for format_ in FORMATS:
        answer = exported(api, room, format=format_, source="observed")
        assert answer.headers["Tidemap-Revision"] == "0"


@pytest.mark.parametrize(
    ("query", "columns"),
    [
        ({}, [[1, 1], [0, UNSEEN], [1, UNSEEN]]),
        ({"z_min": 0.5}, [[0, 1], [0, UNSEEN], [1, UNSEEN]]),
        ({"z_min": 0.75, "z_max": 0.75}, [[0, 1], [UNSEEN, UNSEEN], [1, UNSEEN]]),
        ({"z_max": 0.5}, [[1, 1], [0, UNSEEN], [UNSEEN, UNSEEN]]),
        ({"time": NOW - 2 * HOUR, "z_min": 0.5}, [[0, 1], [0, UNSEEN], [0, UNSEEN]]),
        ({"time": NOW - 2 * DAY}, [[UNSEEN, UNSEEN]] * 3),
    ],
)
def test_a_column_is_occupied_where_one_cell_of_the_band_is(
    api: Api, room: str, query: dict[str, float], columns: list[list[int]]
) -> None:
    answer = exported(api, room, format="nav2", source="observed", **query)
    assert plan(answer) == columns
    described = yaml.safe_load(zipfile.ZipFile(io.BytesIO(answer.content)).read("map.yaml"))
    assert (described["origin"], described["resolution"]) == ([-1.0, 2.0, 0.0], 0.5)


def test_what_is_uncertain_at_the_confidence_is_unknown(api: Api, lab: str) -> None:
    """By cell: a wall, never occupied, a door that follows the hours."""
    for time, confidence in ((NOON, 0.75), (NOON, 0.999), (NOW + 3 * HOUR, 0.75)):
        view = done(api.get(f"/locations/{lab}/state?time={time}&confidence={confidence}"))
        said = dict(zip(view["cell"], view["verdict"], strict=True))
        states = exported(api, lab, format="npz", time=time, confidence=confidence)
        with np.load(io.BytesIO(states.content)) as arrays:
            found = arrays["state"].reshape(-1)
            assert arrays["probability"].reshape(-1)[view["cell"]] == pytest.approx(view["probability"])
            assert np.isnan(arrays["probability"].reshape(-1)[3:]).all()
            assert (arrays["frame"], arrays["revision"]) == ("map", 1)
        words = {-1: None, 0: "free", 1: "occupied", 2: "uncertain"}
        assert [words[state] for state in found.tolist()] == [said.get(cell) for cell in range(24)]
        tree = octomap.read(exported(api, lab, format="octomap", time=time, confidence=confidence).content)
        low, stop = np.array([20, 40, 0]) + octomap.CENTRE, np.array([24, 43, 2]) + octomap.CENTRE
        thresholded = np.where((found == OCCUPIED) | (found == FREE), found, -1).astype(np.uint8)
        assert tree.states(low, stop).tolist() == thresholded.tolist()


def test_given_chooses_the_rhythm_alone(api: Api, lab: str) -> None:
    for given in ("observations", "model"):
        time = NOW + 600.0
        view = done(api.get(f"/locations/{lab}/state?time={time}&given={given}"))
        answer = exported(api, lab, format="arrow", time=time, given=given)
        table = pa.ipc.open_stream(answer.content).read_all()
        assert table["cell"].to_pylist() == view["cell"]
        assert table["probability"].to_pylist() == pytest.approx(view["probability"])
        assert table["verdict"].to_pylist() == view["verdict"]


def test_a_graded_map_is_a_picture_with_shades_and_transparency(api: Api, lab: str) -> None:
    answer = exported(api, lab, format="nav2", mode="scale")
    archive = zipfile.ZipFile(io.BytesIO(answer.content))
    described = yaml.safe_load(archive.read("map.yaml"))
    assert (described["mode"], described["occupied_thresh"], described["free_thresh"]) == ("scale", 1.0, 0.0)
    with Image.open(io.BytesIO(archive.read(described["image"]))) as image:
        shade, alpha = np.asarray(image).transpose(2, 1, 0)[:, :, ::-1]
    with np.load(io.BytesIO(exported(api, lab, format="npz").content)) as arrays:
        probability = arrays["probability"]
    seen = ~np.isnan(probability).all(axis=2)
    assert ((alpha == 255) == seen).all()
    percentage = np.rint(100 * (1 - shade[seen] / 255))
    assert percentage == pytest.approx(100 * np.nanmax(probability[seen], axis=1), abs=0.7)


def test_clouds_are_the_centres_of_occupied_cells(api: Api, room: str) -> None:
    centres = [[-0.75, 2.25, 0.25], [-0.75, 2.75, 0.25], [-0.75, 2.75, 0.75], [-0.75, 2.75, 1.25], [0.25, 2.25, 0.75]]
    polygon = exported(api, room, format="ply", source="observed").content
    assert ply.read(polygon).tolist() == centres
    assert pcd.read(exported(api, room, format="pcd", source="observed").content).tolist() == centres
    second_reader: Any = trimesh.load(io.BytesIO(polygon), file_type="ply")
    assert np.array_equal(second_reader.vertices, centres)
    assert len(ply.read(exported(api, room, format="ply", source="observed", mode="scale").content)) == 9


def test_octomap_reads_the_map(api: Api, room: str, tmp_path: Path) -> None:
    pyoctomap = pytest.importorskip("pyoctomap", reason="OctoMap has no wheel for this machine")
    for mode, suffix in (("trinary", "bt"), ("scale", "ot")):
        answer = exported(api, room, format="octomap", mode=mode, source="observed")
        assert answer.headers["Content-Disposition"].endswith(f'"{room}.{suffix}"')
        file = tmp_path / f"map.{suffix}"
        file.write_bytes(answer.content)
        tree = pyoctomap.OcTree(0.5)
        if suffix == "bt":
            assert tree.readBinary(str(file))
        else:
            tree = tree.read(str(file))
        states = tree.getLabels(np.array([[-0.75, 2.25, 0.25], [-0.75, 2.25, 0.75], [0.25, 2.75, 0.25]]))
        assert states.tolist() == [1, 0, -1]


def test_a_grid_off_octomaps_faces_is_moved_and_the_file_says_so(api: Api) -> None:
    name = api.location(kind="grid3d", grid={**GRID, "origin": [0.1, 0.0, 0.0]})
    api.look(name, (NOW - HOUR, [0], []))
    content = exported(api, name, format="octomap", source="observed").content
    assert b"# moved by -0.1 0 0 m" in content
    assert octomap.read(content).key.tolist() == [[octomap.CENTRE] * 3]


def test_a_grid_beyond_octomaps_reach_is_refused_in_words(api: Api) -> None:
    name = api.location(kind="grid3d", grid={**GRID, "origin": [20_000.0, 0.0, 0.0]})
    found = problem(api.get(f"/locations/{name}/export?format=octomap&source=observed"), 422)
    assert "32768 cells" in found["errors"][0]["message"]


def test_an_empty_location_is_an_empty_file(api: Api) -> None:
    name = api.location(kind="grid3d", grid=GRID)
    for mode in ("trinary", "scale"):
        for format_ in FORMATS:
            exported(api, name, format=format_, source="observed", mode=mode)
        assert octomap.read(exported(api, name, format="octomap", source="observed", mode=mode).content).code.size == 0


def test_a_flat_location_and_a_door(api: Api, door: str) -> None:
    name = api.location(kind="grid2d", grid={"resolution_m": 1.0, "shape": [2, 3]})
    api.look(name, (NOW - HOUR, [0], [5]))
    answer = exported(api, name, format="nav2", source="observed")
    assert answer.headers["Content-Type"] == "application/zip"
    assert answer.headers["Content-Disposition"] == f'attachment; filename="{name}.nav2.zip"'
    assert answer.headers["Tidemap-Time"] == "2026-03-02T12:30:00Z"
    assert plan(answer) == [[1, UNSEEN, UNSEEN], [UNSEEN, UNSEEN, 0]]
    with np.load(io.BytesIO(exported(api, door, format="npz").content)) as arrays:
        assert arrays["probability"].shape == (1,)


def test_the_time_is_now_unless_said(api: Api, room: str) -> None:
    answer = api.get(f"/locations/{room}/export?format=nav2&source=observed")
    assert answer.headers["Tidemap-Time"] == "2026-03-02T00:00:00Z"

"""Scans over HTTP: what becomes of one, and of those whose place in the map is not known."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from tests.api.house import ARROW, HOUR, NOW, Api, arrow, done, npy_file, open_house, problem
from tests.support.rooms import CORRIDOR, LAB, VIEWS, around, level, off_by, sweep
from tests.support.scans import covariance, files
from tests.unit.formats import clouds
from tidemap.api.budget import Share
from tidemap.api.long_questions import answered
from tidemap.space.grid import GridGeometry
from tidemap.space.scan import Scan

GRID = {"origin": [-0.2, -0.2, -0.2], "resolution_m": 0.1, "shape": [84, 64, 32]}
GEOMETRY = GridGeometry("map", (-0.2, -0.2, -0.2), 0.1, (84, 64, 32))
STATED = covariance(0.04, 2.0)
POSE = level(2.5, 3.2, 1.1, 0.4)


@pytest.fixture(scope="module")
def api(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Api]:
    """A site that takes bodies of a few megabytes."""
    with open_house(tmp_path_factory.mktemp("scans"), max_body_bytes=2**23) as house:
        yield house


@pytest.fixture(scope="module")
def mapped(api: Api) -> str:
    """A lab that was scanned from poses that were known, with a model."""
    name, chance = api.location(kind="grid3d", grid=GRID, estimator="static"), np.random.default_rng(0)
    for i in range(12):
        pose = level(*VIEWS[i % 6], 1.1, chance.uniform(-3, 3))
        post(api, name, seen(pose, chance, 20_000), pose, time=NOW - HOUR * (i + 1))
    api.update(name)
    return name


def seen(pose: Any, chance: np.random.Generator, n: int = 2000, room: Any = LAB) -> Any:
    return sweep(room, pose, around(n, chance), chance)


def post(api: Api, name: str, points: Any, pose: Any = POSE, media_type: str | None = None, **said: Any) -> Any:
    """Post a scan; the answer."""
    how = {key: said.pop(key) for key in ("headers", "status", "query") if key in said}
    header = {"time": NOW - 60, "map_from_sensor": pose.values, **said}
    sent = files(header, points) if media_type is None else files(header, points, media_type)
    path = f"/locations/{name}/scans{how.get('query', '')}"
    return done(api.post(path, files=sent, headers=how.get("headers")), how.get("status", 201))


def cells(api: Api, name: str) -> tuple[list[int], list[int]]:
    """What is known of a location's cells, each with its state."""
    api.update(name)
    state = done(api.get(f"/locations/{name}/state?time={NOW}&observed=true"))
    return state["cell"], state["observed"]


POINTS = seen(POSE, np.random.default_rng(4))
PCD_HEAD = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH {n}\nHEIGHT 1\nDATA binary\n"
PLY_HEAD = "ply\nformat binary_little_endian 1.0\nelement vertex {n}\n" + "".join(
    f"property float {axis}\n" for axis in "xyz"
)
FORMS = {
    "npy": (npy_file(POINTS), "application/x-npy"),
    "float64": (npy_file(np.asfortranarray(POINTS, np.float64)), "application/x-npy"),
    "arrow": (arrow({axis: POINTS[:, i] for i, axis in enumerate("xyz")}), ARROW),
    "pcd": (PCD_HEAD.format(n=len(POINTS)).encode() + POINTS.tobytes(), "application/x-pcd"),
    "ply": (PLY_HEAD.format(n=len(POINTS)).encode() + b"end_header\n" + POINTS.tobytes(), "application/x-ply"),
}


@pytest.mark.parametrize("form", FORMS)
def test_what_a_scan_saw_is_what_its_rays_say_in_every_format(api: Api, form: str) -> None:
    name = api.location(kind="grid3d", grid=GRID, estimator="static")
    content, media_type = FORMS[form]
    answer = post(api, name, content, media_type=media_type, max_range=4.0, min_hits=2)
    truth = Scan(POINTS, POSE, max_range_m=4.0, min_hits=2).cast(GEOMETRY)
    assert (answer["accepted"], answer["duplicate"]) == (len(truth.cell), False)
    assert answer["registration"]["verdict"] == "raw_pose"
    assert answer["registration"]["correction"] is None
    assert cells(api, name) == (truth.cell.tolist(), truth.state.tolist())


def test_ranges_as_json_are_points_in_the_plane(api: Api) -> None:
    name = api.location(kind="grid2d", grid={"resolution_m": 0.5, "shape": [20, 20]}, estimator="static")
    form = {
        "time": NOW - 60,
        "map_from_sensor": [5.25, 5.25, 0.3, 0, 0, 0, 1],
        "angle_min": 0.0,
        "angle_increment": np.pi / 2,
        "ranges": [2.0, "inf", None, 99.0],
        "range_max": 3.0,
    }
    answer = done(api.post(f"/locations/{name}/scans", form), 201)
    hit, free = [14 * 20 + 10], [*((10 + i) * 20 + 10 for i in range(4)), *(10 * 20 + 10 + i for i in range(1, 6))]
    assert answer["accepted"] == len(hit) + len(free)
    known = dict(zip(*cells(api, name), strict=True))
    assert known == dict.fromkeys(free, 0) | dict.fromkeys(hit, 1)
    ranges = {key: value for key, value in form.items() if key != "ranges"}
    body = files(ranges, np.array([2.0, np.inf, np.nan, 99.0], np.float32), part="ranges")
    again = api.location(kind="grid2d", grid={"resolution_m": 0.5, "shape": [20, 20]}, estimator="static")
    done(api.post(f"/locations/{again}/scans", files=body), 201)
    assert dict(zip(*cells(api, again), strict=True)) == known


def test_a_pose_that_is_a_little_wrong_is_put_right(api: Api, mapped: str) -> None:
    chance = np.random.default_rng(11)
    wrong = off_by(POSE, np.array([0.08, -0.06, 0.05, 0.02, -0.02, 0.05]))
    points = seen(POSE, chance, 20_000)
    answer = post(api, mapped, points, wrong, covariance=STATED.tolist())
    registration = answer["registration"]
    assert registration["verdict"] == "accepted", registration
    shift = np.array(registration["map_from_sensor"][:3]) - POSE.translation
    assert np.abs(shift).max() < 0.05, "half a cell in each direction"
    assert np.abs(np.array(registration["correction"]["translation_m"]) - [-0.08, 0.06, -0.05]).max() < 0.05
    assert registration["features"]["converged"]
    listed = done(api.get(f"/locations/{mapped}/scans?registration=accepted"))["items"]
    assert [each["registration"] for each in listed] == [registration]
    assert listed[0]["observation"] > 0
    assert (listed[0]["points"], listed[0]["bytes"]) == (20_000, 0)
    never = post(api, mapped, points, wrong, covariance=STATED.tolist(), registration="never", time=NOW - 30)
    assert never["registration"]["verdict"] == "raw_pose"
    np.testing.assert_allclose(never["registration"]["map_from_sensor"], wrong.values, atol=1e-12)
    asked = post(api, mapped, points, wrong, registration="always", time=NOW - 20)
    assert asked["registration"]["verdict"] == "accepted"


def quarantined(api: Api, name: str, time: float = NOW - 600, **how: Any) -> tuple[Any, Any]:
    """A scan of another room, which the map of the lab cannot explain: its points and the answer."""
    points = seen(level(0, 1, 1.1, 0), np.random.default_rng(13), 3000, CORRIDOR)
    points = points[np.linalg.norm(points, axis=1) < 6]
    return points, post(api, name, points, level(4, 3, 1.1, 0.0), covariance=STATED.tolist(), time=time, **how)


def test_what_the_map_cannot_place_is_kept_apart_and_can_be_dropped(api: Api, mapped: str) -> None:
    before = api.facts(mapped)
    points, answer = quarantined(api, mapped)
    assert answer["registration"]["verdict"] == "quarantined", answer
    assert (answer["accepted"], answer["first_time"], answer["anomalies"]) == (0, None, [])
    assert api.facts(mapped) == before, "no cell is written"
    path = f"/locations/{mapped}/scans/{answer['scan']}"
    (listed,) = done(api.get(f"/locations/{mapped}/scans?registration=quarantined"))["items"]
    assert (listed["id"], listed["observation"], listed["points"]) == (answer["scan"], None, len(points))
    assert listed["bytes"] > 0
    assert api.get(f"{path}/points").content == npy_file(points)
    again = done(api.post(f"{path}/replay"))
    assert again["registration"]["verdict"] == "quarantined"
    assert again["scan"] == answer["scan"]
    assert api.delete(path).status_code == 204
    for gone in (api.delete(path), api.get(f"{path}/points"), api.post(f"{path}/replay")):
        problem(gone, 404, "scan-not-found")


def test_a_scan_that_fits_after_an_update_is_stored_once(api: Api) -> None:
    name = api.location(kind="grid3d", grid=GRID, estimator="static")
    chance = np.random.default_rng(21)
    api.look(name, (NOW - 7200, [0], [1]), (NOW - 3600, [0], [1]))
    api.update(name)
    points = seen(POSE, chance, 20_000)
    answer = post(api, name, points, covariance=STATED.tolist())
    assert answer["registration"]["verdict"] == "quarantined", "the map knows nothing there yet"
    for i in range(12):
        pose = level(*VIEWS[i % 6], 1.1, chance.uniform(-3, 3))
        post(api, name, seen(pose, chance, 20_000), pose, time=NOW - 60 * (i + 1))
    api.update(name)
    path = f"/locations/{name}/scans/{answer['scan']}"
    before = api.facts(name)["observations"]
    replayed = done(api.post(f"{path}/replay"))
    assert replayed["registration"]["verdict"] == "accepted", replayed
    assert replayed["accepted"] > 10_000
    assert api.facts(name)["observations"] == before + replayed["accepted"]
    problem(api.post(f"{path}/replay"), 409, "scan-settled")
    problem(api.get(f"{path}/points"), 409, "scan-settled")
    listed = done(api.get(f"/locations/{name}/scans"))["items"]
    mine = next(each for each in listed if each["id"] == answer["scan"])
    assert mine["registration"]["verdict"] == "accepted"
    assert (mine["bytes"], mine["observation"] > 0) == (0, True)


@pytest.fixture
def grown(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The bytes of memory that are asked for from now on."""
    sizes: list[int] = []
    grow = Share.grow

    async def noted(share: Share, size: int) -> None:
        sizes.append(size)
        await grow(share, size)

    monkeypatch.setattr(Share, "grow", noted)
    return sizes


def test_compressed_points_cost_what_they_unpack_to(api: Api, grown: list[int]) -> None:
    name, n = api.location(kind="grid3d", grid=GRID), 20_000
    content = clouds.pcd(np.full(n, 1, np.dtype([(axis, "<f4") for axis in "xyz"])), "binary_compressed")
    assert len(content) < n
    post(api, name, content, media_type="application/x-pcd")
    assert sum(grown) >= 16 * n * 12
    grown.clear()
    damaged = {"files": files({"time": NOW - 60, "map_from_sensor": POSE.values}, content[:-1], "application/x-pcd")}
    problem(api.post(f"/locations/{name}/scans", **damaged), 400, "unreadable-body")
    assert sum(grown) < 16 * n


def test_unpacking_from_quarantine_is_bounded(
    api: Api, mapped: str, grown: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    points, answer = quarantined(api, mapped, NOW - 900)
    (listed,) = (each for each in done(api.get(f"/locations/{mapped}/scans"))["items"] if each["id"] == answer["scan"])
    assert listed["bytes"] >= points.nbytes, "what they take unpacked, at least"
    asked: list[object] = []

    async def noted(request: Any, work: Any) -> Any:
        asked.append(request)
        return await answered(request, work)

    monkeypatch.setattr("tidemap.api.routers.scans.answered", noted)
    path = f"/locations/{mapped}/scans/{answer['scan']}"
    grown.clear()
    assert api.get(f"{path}/points").content == npy_file(points)
    assert len(asked) == 1, "as a long question: a few at a time"
    assert sum(grown) >= 3 * points.nbytes
    grown.clear()
    done(api.post(f"{path}/replay"))
    assert sum(grown) >= 16 * points.nbytes
    assert api.delete(path).status_code == 204


def test_who_replays_and_drops_a_scan_is_in_the_audit_log(api: Api, mapped: str) -> None:
    path = f"/locations/{mapped}/scans/{quarantined(api, mapped, NOW - 1000)[1]['scan']}"
    done(api.post(f"{path}/replay"))
    assert api.delete(path).status_code == 204
    problem(api.delete(path), 404)
    entries = done(api.get("/audit?limit=2"))["items"]
    assert [(each["action"], each["target"]) for each in entries] == [
        ("DELETE /locations/{name}/scans/{scan_id}", path),
        ("POST /locations/{name}/scans/{scan_id}/replay", f"{path}/replay"),
    ], "and what was refused is not"


@pytest.mark.parametrize("verdict", ["raw_pose", "quarantined"])
def test_the_same_scan_under_its_key_is_stored_once(api: Api, mapped: str, verdict: str) -> None:
    key, time = {"Idempotency-Key": f"scan-{verdict}"}, NOW - 700
    if verdict == "quarantined":
        first, again = (quarantined(api, mapped, time, headers=key, status=s)[1] for s in (201, 200))
    else:
        first, again = (post(api, mapped, POINTS, time=time, headers=key, status=s) for s in (201, 200))
    assert (first["duplicate"], again["duplicate"], again["accepted"]) == (False, True, 0)
    assert (again["scan"], again["registration"]) == (first["scan"], first["registration"])
    header = {"time": time, "map_from_sensor": POSE.values, "min_hits": 3}
    other = api.post(f"/locations/{mapped}/scans", files=files(header, POINTS), headers=key)
    problem(other, 409, "idempotency-key-reused")


def test_scans_are_listed_page_by_page_newest_first(api: Api) -> None:
    name = api.location(kind="grid3d", grid=GRID)
    ids = [post(api, name, POINTS, time=NOW - 60 * i, query="?source=spot")["scan"] for i in range(1, 6)]
    found, after = [], ""
    while True:
        page = done(api.get(f"/locations/{name}/scans?limit=2{after}"))
        found += page["items"]
        if page["next"] is None:
            break
        after = f"&after={page['next']}"
    assert [each["id"] for each in found] == ids[::-1]
    assert {each["source"] for each in found} == {"spot"}
    assert done(api.get(f"/locations/{name}/scans?registration=quarantined"))["items"] == []


def test_a_scan_that_is_too_old_to_be_kept_leaves_nothing(api: Api) -> None:
    name = api.location(kind="grid3d", grid=GRID, retention=600)
    answer = post(api, name, POINTS, time=NOW - 3600)
    assert (answer["accepted"], answer["scan"], answer["registration"]) == (0, None, None)
    assert answer["dropped"] > 1000
    assert done(api.get(f"/locations/{name}/scans"))["items"] == []


def test_a_map_in_the_layout_of_ros_is_not_transposed(api: Api) -> None:
    name = api.location(kind="grid2d", grid={"resolution_m": 1.0, "shape": [3, 3]}, estimator="static")
    percent = np.array([[100, 65, 64], [0, 25, 26], [-1, 50, 0]], np.int8)  # rows of y, upwards
    path = f"/locations/{name}/observations?time={NOW - 60}&layout=ros"
    headers = {"Content-Type": "application/x-npy"}
    answer = done(api.post(path, content=npy_file(percent), headers=headers), 201)
    assert answer["accepted"] == 5
    assert cells(api, name) == ([0, 1, 3, 4, 8], [1, 0, 1, 0, 0])
    wide = api.location(kind="grid2d", grid={"resolution_m": 1.0, "shape": [3, 2]})
    path = f"/locations/{wide}/observations?time={NOW - 60}&layout=ros"
    assert done(api.post(path, content=npy_file(percent[:2]), headers=headers), 201)["accepted"] == 4
    for wrong, says in ((percent[:, :2], "shape"), (np.full((2, 3), 101, np.uint8), "percent")):
        found = problem(api.post(path, content=npy_file(wrong), headers=headers), 422)
        assert says in found["detail"]
    problem(api.post(f"/locations/{name}/observations?layout=ros", {"time": [1], "state": [1]}), 422)


def test_an_answer_says_where_its_cells_are(api: Api, mapped: str) -> None:
    state = done(api.get(f"/locations/{mapped}/state"))
    assert state["grid"] == {"frame": "map", **GRID}

"""Scans that must be refused, each by a name and words that help, and nothing stored."""

import io
import json
from typing import Any

import httpx
import numpy as np
import pytest
import zstandard
from numpy.lib import format as npformat

from tests.api.house import ARROW, NPY, arrow, npy_file
from tests.api.refusals import DOOR, LAB, NAN, Case, T, Untouched, raw
from tests.support.scans import files

POSE = [11.0, 21.0, 0.5, 0.0, 0.0, 0.0, 1.0]
POINTS = npy_file(np.ones((5, 3), np.float32))
PCD = b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 2\nHEIGHT 1\nDATA binary\n" + bytes(24)
PLY = (
    b"ply\nformat ascii 1.0\nelement vertex 2\n"
    b"property float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n"
)
SCANS = f"{LAB}/scans"


def scan(
    names: str | None,
    says: str = "",
    points: Any = POINTS,
    media_type: str = NPY,
    status: int = 422,
    part: str = "points",
    path: str = SCANS,
    **said: Any,
) -> Case:
    """A scan with something wrong in what is said, or in its points."""
    header = json.dumps({"time": T, "map_from_sensor": POSE, **said}).encode()
    return Case("POST", path, status, names, says, {"files": files(header, points, media_type, part)})


def body(content: bytes, media_type: str, status: int, says: str, names: str | None = None) -> Case:
    return raw(SCANS, content, status, names, says, media_type)


def ranges(names: str | None, says: str = "", status: int = 422, **said: Any) -> Case:
    """The same of ranges as JSON."""
    form = {"time": T, "map_from_sensor": POSE, "angle_min": 0.0, "angle_increment": 0.1, "ranges": [1.0], **said}
    return body(json.dumps(form).encode(), "application/json", status, says, names)


def far(value: float) -> Any:
    return npy_file(np.full((3, 3), value, np.float32))


def lying(shape: tuple[int, ...], n_bytes: int) -> bytes:
    """An npy file that declares a shape, and the bytes behind its header."""
    head = io.BytesIO()
    npformat.write_array_header_1_0(head, {"descr": "<f4", "fortran_order": False, "shape": shape})
    return head.getvalue() + bytes(n_bytes)


LIES = [((-5, -3), 60), ((0, 2**70), 0), ((1,) * 70, 4), ((2**62, 2**62, 0), 0)]
CASES = [
    *(scan(None, "declares the shape", points=lying(*lie), status=400) for lie in LIES),
    *(
        scan(None, "declares the shape", lying(*lie), part="ranges", status=400, angle_min=0.0, angle_increment=0.1)
        for lie in LIES
    ),
    scan("map_from_sensor[0]", "finite", map_from_sensor=[NAN, *POSE[1:]]),
    scan("map_from_sensor", "no rotation", map_from_sensor=[0.0] * 7),
    scan("map_from_sensor", "norm", map_from_sensor=[*POSE[:6], 0.7]),
    scan("map_from_sensor", "mirrors", map_from_sensor=np.diag([-1.0, 1, 1, 1]).tolist()),
    scan("map_from_sensor", "outside of the grid", map_from_sensor=[5000.0, *POSE[1:]]),
    scan("map_from_sensor", "", map_from_sensor="here"),
    scan("covariance", "negative", covariance=(-np.eye(6)).tolist()),
    scan("covariance", "symmetric", covariance=np.tri(6).tolist()),
    scan("covariance", "unknown", covariance=np.zeros((6, 6)).tolist()),
    scan("covariance", "", covariance=np.eye(5).tolist()),
    scan("covariance[0][0]", "finite", covariance=[[NAN] * 6] * 6),
    scan("frame", "'map'", frame="base_link"),
    scan("time", "future", time=T + 1e8),
    scan("time", "past", time=0.0),
    scan("time", "", time=NAN),
    scan("max_range", "", max_range=0.0),
    scan("max_range", "", max_range=-1.0),
    scan("min_hits", "", min_hits=0),
    scan("registration", "", registration="maybe"),
    scan("angle_min", "ranges", angle_min=0.0),
    scan("colour", "not known", colour="red"),
    scan("points", "NaN", points=far(np.nan)),
    scan("points", "shape", points=npy_file(np.ones((5, 4), np.float32))),
    scan("points", "shape", points=npy_file(np.ones(5, np.float32))),
    scan("points", "type", points=npy_file(np.ones((5, 3), np.int32))),
    scan("points", "type", points=npy_file(np.ones((5, 3), np.float16))),
    scan(None, "declare", points=POINTS[:-1], status=400),
    scan(None, "no npy", points=b"\x93NUMPY", status=400),
    scan(None, "", points=PCD[:-1], media_type="application/x-pcd", status=400),
    scan(None, "", points=PCD.replace(b"WIDTH 2", b"WIDTH 9999999"), media_type="application/x-pcd", status=400),
    scan(None, "", points=PLY, media_type="application/x-ply", status=400),
    scan(None, "", points=b"", media_type="application/x-ply", status=400),
    scan("z", "type", points=arrow({"x": [1.0], "y": [1.0], "z": [1]}), media_type=ARROW),
    scan("y", "missing", points=arrow({"x": [1.0], "z": [1.0]}), media_type=ARROW),
    scan("t", "no other", points=arrow({"x": [1.0], "y": [1.0], "t": [1.0]}), media_type=ARROW),
    scan(None, "no Arrow", points=b"ARROW", media_type=ARROW, status=400),
    scan(None, "application/x-pcd", media_type="application/json", status=415),
    scan("cloud", "no other", part="cloud"),
    scan("ranges", "Content-Type", part="ranges", media_type=ARROW, angle_min=0.0, angle_increment=0.1),
    scan("ranges", "shape", part="ranges", angle_min=0.0, angle_increment=0.1),
    scan("body", "no grid", path=f"{DOOR}/scans"),
    scan(None, "no location", path="/locations/nowhere/scans", status=404),
    ranges("ranges[0]", "", ranges=["far"]),
    ranges("ranges", "", ranges=[]),
    ranges("ranges", "", ranges=None),
    ranges("ranges", "NaN", ranges=[None]),
    ranges("max_range", "clear", ranges=["inf"]),
    ranges("angle_min", "need", angle_min=None),
    ranges("angles", "either", angles=[1.0]),
    ranges("angles", "1 ranges", angles=[1.0, 2.0], angle_min=None, angle_increment=None),
    ranges("ranges", "", ranges=[1.0] * 100_001),
    ranges("map_from_sensor", "outside", map_from_sensor=[0.0, 0.0, 50.0, 0, 0, 0, 1]),
    body(b"{}", "application/json", 422, "", "ranges"),
    body(b"{", "application/json", 400, "JSON"),
    body(b"", "application/json", 422, ""),
    body(b"x", "text/plain", 415, "multipart"),
    body(b"x", "multipart/form-data", 400, "boundary"),
    body(b"x", "multipart/form-data; boundary=b", 400, "no multipart"),
    body(b"--b\r\nContent-Type: text/plain\r\n\r\n", "multipart/form-data; boundary=b", 400, "cut short"),
    body(b"--b--\r\n", "multipart/form-data; boundary=b", 422, "points", "header"),
    body(
        b"".join(b'--b\r\nContent-Disposition: form-data; name="%d"\r\n\r\n\r\n' % i for i in range(9)) + b"--b--\r\n",
        "multipart/form-data; boundary=b",
        400,
        "more than",
    ),
    Case("GET", f"{SCANS}?registration=lost", 422, "registration"),
    Case("GET", f"{SCANS}?after=x", 422, "after"),
    Case("GET", f"{SCANS}/99/points", 404, None, "no scan 99"),
    Case("POST", f"{SCANS}/99/replay", 404, None, "no scan 99"),
    Case("DELETE", f"{SCANS}/99", 404, None, "no scan 99"),
    Case("GET", "/locations/nowhere/scans", 404),
]


@pytest.mark.parametrize(
    "case", [pytest.param(case, id=f"{i}-{case.names}-{case.says}") for i, case in enumerate(CASES)]
)
def test_it_is_refused_and_nothing_is_stored(site: Untouched, case: Case) -> None:
    site.refuse(case)


def test_too_many_points_are_refused_before_they_are_looked_at(site: Untouched) -> None:
    head = npy_file(np.zeros((0, 3), np.float32)).replace(b"(0, 3)", b"(10000000, 3)")
    site.refuse(scan(None, "declares", points=head, status=400))


@pytest.mark.parametrize(
    ("content", "media_type"),
    [
        (PCD.replace(b"WIDTH 2", b"WIDTH 10000000"), "application/x-pcd"),
        (PLY.replace(b"vertex 2", b"vertex 10000000"), "application/x-ply"),
    ],
)
def test_ten_million_declared_points_are_refused(site: Untouched, content: bytes, media_type: str) -> None:
    site.refuse(scan(None, "2000000", points=content, media_type=media_type, status=400))


def test_ten_million_packed_points_are_refused(site: Untouched) -> None:
    said = json.dumps({"time": T, "map_from_sensor": POSE}).encode()
    sent = httpx.Request("POST", "http://x", files=files(said, np.zeros((10_000_000, 3), np.float32)))
    packed = zstandard.compress(sent.read())
    assert len(packed) < 100_000
    headers = {"Content-Type": sent.headers["Content-Type"], "Content-Encoding": "zstd"}
    site.refuse(Case("POST", SCANS, 413, None, "", {"content": packed, "headers": headers}))


def test_any_bytes_are_refused_with_words(site: Untouched) -> None:
    chance = np.random.default_rng(1)
    for media_type, content in (("application/x-pcd", PCD), ("application/x-ply", PLY), (NPY, POINTS)):
        for _ in range(60):
            broken = bytearray(content)
            for at in chance.integers(0, len(broken), 3):
                broken[at] = chance.integers(0, 256)
            case = scan(None, points=bytes(broken), media_type=media_type, map_from_sensor=[9e3, *POSE[1:]])
            answer = site.api.request(case.method, case.path, **case.how)
            assert answer.status_code in (400, 422), answer.text
    site.check()


def test_a_spoilt_scan_of_the_map_is_stored_whole_or_refused(site: Untouched) -> None:
    """Its pose is right, so that what is still readable goes all the way."""
    chance = np.random.default_rng(2)
    cloud = arrow({axis: np.ones(5, np.float32) for axis in "xyz"})
    forms = (("application/x-pcd", PCD), ("application/x-ply", PLY + b"4 5 6\n"), (NPY, POINTS), (ARROW, cloud))
    stored = 0
    for media_type, content in forms:
        for _ in range(40):
            broken = bytearray(content)
            for at in chance.integers(0, len(broken), chance.integers(0, 3)):
                broken[at] = chance.integers(0, 256)
            case = scan(None, points=bytes(broken), media_type=media_type, max_range=2.0)
            answer = site.api.request(case.method, case.path, **case.how)
            assert answer.status_code in (201, 400, 422), answer.text
            if answer.status_code == 201:
                site.accept()
                stored += 1
            else:
                site.check()
    assert stored > 10

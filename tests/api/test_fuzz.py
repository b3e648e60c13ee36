"""Whatever bytes a post holds, reading it ends in measurements or in an error that says why, and in bounded memory."""

import gzip
import json
import tracemalloc
from collections.abc import Callable
from itertools import product
from operator import itemgetter
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
import zstandard
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import boolean_dtypes, floating_dtypes, integer_dtypes, scalar_dtypes

from tests.api.house import HOUR, NOW, arrow, npy, npy_file, problem
from tests.api.refusals import DOOR, LAB, Untouched
from tests.support.parsing import Target, parse
from tidemap.errors import InvalidInputError, UnreadableBodyError
from tidemap.formats.registry import Body
from tidemap.history.measurements import UNAVAILABLE
from tidemap.media_types import ARROW, JSON, NPY
from tidemap.space.grid import SINGLE, GridGeometry

TARGETS = {
    "state": Target(SINGLE, NOW),
    "grid3d": Target(GridGeometry("map", (0.0, 0.0, 0.0), 0.5, (4, 3, 2)), NOW),
}
TIMES = np.array([0.0, 60.0, 120.0])
STATES = np.array([0, 1, 1], np.uint8)
CELLS = np.array([3, 4, 5], np.uint32)
TABLES = {
    "state": arrow({"time": TIMES, "state": STATES}),
    "grid3d": arrow({"time": TIMES, "cell": CELLS, "state": STATES}),
}
FILES = {
    "state": npy({"time": TIMES, "state": STATES}),
    "grid3d": npy({"time": TIMES, "cell": CELLS, "state": STATES}),
}
FORMS = {
    "state": {"time": [0, 60.0, "1970-01-01T00:02:00Z"], "state": [0, 1, 1]},
    "grid3d": {"observations": [{"time": 0, "occupied": [3, [1, 2, 0]], "free": [4]}, {"time": 60, "free": [5]}]},
}
HEADER = (
    r"\{'descr': (\[\('time', '[<>|]?[fiuMOSV][0-8]'\), \('state', '\|[ub]1'\)\]|'[<|][fOV]8'), "
    r"'fortran_order': (True|False), 'shape': \((-?[0-9]{1,12}L?,?){0,3}\)[,} ]{0,3}\n?"
)
slow = settings(max_examples=300, suppress_health_check=[HealthCheck.too_slow])


def read(content: bytes, kind: str, media_type: str) -> None:
    """Read a body; what comes out is measurements that can be stored, or an error in words."""
    target = TARGETS[kind]
    try:
        found = parse(Body(content, media_type), target)
    except (UnreadableBodyError, InvalidInputError) as error:
        str(error).encode()  # it can be sent
        return
    assert len(found) > 0
    assert np.isfinite(found.time).all()
    assert (found.time <= NOW).all()
    assert (found.cell < target.grid.n_cells).all()
    assert (found.state <= UNAVAILABLE).all()


@pytest.mark.parametrize("kind", TARGETS)
@slow
@given(
    spoilt=st.lists(st.tuples(st.integers(0, 2000), st.integers(0, 255)), min_size=1, max_size=4),
    cut=st.integers(0, 40),
)
def test_spoilt_arrow(kind: str, spoilt: list[tuple[int, int]], cut: int) -> None:
    content = bytearray(TABLES[kind])
    for at, value in spoilt:
        content[at % len(content)] = value
    read(bytes(content[: len(content) - cut]), kind, ARROW)


@pytest.mark.parametrize("kind", TARGETS)
@slow
@given(
    spoilt=st.lists(st.tuples(st.integers(0, 200), st.integers(0, 255)), min_size=1, max_size=4),
    cut=st.integers(0, 40),
)
def test_spoilt_npy(kind: str, spoilt: list[tuple[int, int]], cut: int) -> None:
    content = bytearray(FILES[kind])
    for at, value in spoilt:
        content[at % len(content)] = value
    read(bytes(content[: len(content) - cut]), kind, NPY)


first = itemgetter(0)
dtypes = floating_dtypes() | integer_dtypes() | boolean_dtypes() | scalar_dtypes()


@pytest.mark.parametrize("kind", TARGETS)
@slow
@given(
    fields=st.lists(st.tuples(st.sampled_from(["time", "cell", "state", "x"]), dtypes), max_size=4, unique_by=first),
    length=st.integers(0, 4),
    noise=st.binary(min_size=1, max_size=30),
)
def test_any_array(kind: str, fields: list[Any], length: int, noise: bytes) -> None:
    dtype = np.dtype(fields)
    rows = np.resize(np.frombuffer(noise, np.uint8), length * dtype.itemsize)
    read(npy_file(np.ndarray((length,), dtype, rows.tobytes())), kind, NPY)


@pytest.mark.parametrize("kind", TARGETS)
@slow
@given(header=st.text(st.characters(max_codepoint=255), max_size=100) | st.from_regex(HEADER, fullmatch=True))
def test_any_header_of_npy(kind: str, header: str) -> None:
    text = header.encode("latin-1")
    read(b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + b"\0" * 13, kind, NPY)


@pytest.mark.parametrize("kind", TARGETS)
@slow
@given(spoilt=st.lists(st.tuples(st.integers(0, 200), st.integers(0, 255)), max_size=3), cut=st.integers(0, 30))
def test_spoilt_json(kind: str, spoilt: list[tuple[int, int]], cut: int) -> None:
    content = bytearray(json.dumps(FORMS[kind]).encode())
    for at, value in spoilt:
        content[at % len(content)] = value
    read(bytes(content[: len(content) - cut]), kind, JSON)


values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.sampled_from([0, 1, 23, 24, 0.0, 1e11, "1970-01-01T00:00:00Z", "1970-01-01T00:00:00", "time"])
    | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(
            st.sampled_from(["time", "state", "occupied", "free", "observations", "x"]), inner, max_size=4
        )
    ),
    max_leaves=20,
)


@pytest.mark.parametrize("kind", TARGETS)
@slow
@given(value=values)
@example(value={"time": [1], "state": [1], "\ud800": float("nan")})
def test_any_json(kind: str, value: Any) -> None:
    forms: list[Any] = [value, {"time": value, "state": value}, {"time": [0], "state": [value]}]
    forms += [{"observations": value}, {"observations": [value]}, {"observations": [{"time": 0, "occupied": value}]}]
    for form in forms:
        read(json.dumps(form).encode(), kind, JSON)


@pytest.mark.parametrize("kind", TARGETS)
@pytest.mark.parametrize("media_type", [JSON, ARROW, NPY])
@slow
@given(content=st.binary(max_size=200))
def test_any_bytes(kind: str, media_type: str, content: bytes) -> None:
    read(content, kind, media_type)


SIZES = [0, 1, 2, 3, 7, 8, 127, 255, 256, 2**16 - 1, 2**24, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**63 - 1, 2**64 - 1]
"""What a length or an offset may say that is not one."""
locations = st.integers(0, 1 << 12)
few = st.binary(min_size=1, max_size=9)


def flip(content: bytearray, at: int, how: bytes) -> None:
    content[at] ^= 1 << how[0] % 8


def overwrite(content: bytearray, at: int, how: bytes) -> None:
    content[at : at + len(how)] = how[: len(content) - at]


def insert(content: bytearray, at: int, how: bytes) -> None:
    content[at:at] = how


def cut(content: bytearray, at: int, how: bytes) -> None:
    del content[at : at + how[0]]


def repeat(content: bytearray, at: int, how: bytes) -> None:
    content[at:at] = content[at : at + how[0]] * (1 + how[-1])


def truncate(content: bytearray, at: int, how: bytes) -> None:
    del content[at:]


def resize(content: bytearray, at: int, how: bytes) -> None:
    """Where 32 or 64 bits stand, which are aligned in Arrow and npy: another number."""
    width = 4 + 4 * (how[0] % 2)
    at -= at % 4
    number = SIZES[how[-1] % len(SIZES)] % (1 << 8 * width)
    content[at : at + width] = number.to_bytes(width, "little")


CHANGES: list[Callable[[bytearray, int, bytes], None]] = [flip, overwrite, insert, cut, repeat, truncate, resize]
changes = st.lists(st.tuples(st.sampled_from(CHANGES), locations, few), min_size=1, max_size=4)
PACKERS: dict[str, Callable[[bytes], bytes]] = {"identity": bytes, "gzip": gzip.compress, "zstd": zstandard.compress}
SEEN = NOW - HOUR
POSTS = {
    "arrow": (LAB, ARROW, "", arrow({"time": SEEN + TIMES, "cell": CELLS, "state": STATES})),
    "npy": (LAB, NPY, "", npy({"time": SEEN + TIMES, "cell": CELLS, "state": STATES})),
    "grid": (LAB, NPY, f"?time={SEEN}", npy_file(np.eye(4, 6, dtype=np.uint8).reshape(4, 3, 2))),
    "json": (LAB, JSON, "", json.dumps({"observations": [{"time": SEEN, "occupied": [3, [1, 2, 0]]}]}).encode()),
    "state": (DOOR, JSON, "", json.dumps({"time": (SEEN + TIMES).tolist(), "state": [0, 1, 1]}).encode()),
    "state-arrow": (DOOR, ARROW, "", arrow({"time": SEEN + TIMES, "state": STATES})),
}
MAX_BYTES = 40 * 2**20
"""What such a post may take; as many bytes as the largest of them claims to hold would be a thousand times that."""


def changed(content: bytes, how: list[Any]) -> bytes:
    spoilt = bytearray(content)
    for change, at, data in how:
        if spoilt:
            change(spoilt, at % len(spoilt), data)
    return bytes(spoilt)


@pytest.mark.parametrize(("form", "packing"), list(product(POSTS, PACKERS)))
def test_a_changed_post_is_stored_whole_or_not_at_all(site: Untouched, form: str, packing: str) -> None:
    """It is spoilt before it is packed, after that, or both."""
    path, media_type, query, good = POSTS[form]
    headers = {"Content-Type": media_type, "Content-Encoding": packing}

    def count() -> int:
        return int(site.api.facts(path.removeprefix("/locations/"))["observations"])

    held = [count()]

    @settings(max_examples=40, derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))
    @given(before=changes | st.just([]), after=changes | st.just([]))
    def run(before: list[Any], after: list[Any]) -> None:
        content = changed(PACKERS[packing](changed(good, before)), after)
        tracemalloc.reset_peak()
        answer = site.api.post(f"{path}/observations{query}", content=content, headers=headers)
        assert tracemalloc.get_traced_memory()[1] - began < MAX_BYTES
        if answer.status_code == 201:
            held.append(count())
            assert held[-1] == held[-2] + answer.json()["accepted"] > held[-2]
            site.accept()
        else:
            assert answer.status_code in (400, 413, 422), answer.text
            problem(answer, answer.status_code)
            site.check()

    tracemalloc.start()
    began, arrow_held = tracemalloc.get_traced_memory()[0], pa.default_memory_pool().max_memory()
    try:
        run()
    finally:
        tracemalloc.stop()
    assert (pa.default_memory_pool().max_memory() or 0) - (arrow_held or 0) < MAX_BYTES

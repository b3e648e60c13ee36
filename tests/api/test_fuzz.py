"""Whatever bytes a post holds, reading it ends in measurements or in an error that says why."""

import json
from operator import itemgetter
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import boolean_dtypes, floating_dtypes, integer_dtypes, scalar_dtypes

from app.errors import InvalidInputError, UnreadableBodyError
from app.ingest.observation import ARROW, JSON, NPY, Body, Target, parse
from app.space.grid import SINGLE, Grid
from tests.api.house import NOW, arrow, npy, npy_file

TARGETS = {
    "state": Target("state", SINGLE, NOW),
    "grid3d": Target("grid3d", Grid("map", (0.0, 0.0, 0.0), 0.5, (4, 3, 2)), NOW),
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
    assert (found.state <= 1).all()


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

"""Whatever bytes a post holds, reading it ends in measurements or in an error that says why."""

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from app.errors import InvalidInputError, UnreadableBodyError
from app.ingest.observation import ARROW, JSON, Body, Target, parse
from app.space.grid import SINGLE, Grid
from tests.api.house import NOW, arrow

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
FORMS = {
    "state": {"time": [0, 60.0, "1970-01-01T00:02:00Z"], "state": [0, 1, 1]},
    "grid3d": {"observations": [{"time": 0, "occupied": [3, [1, 2, 0]], "free": [4]}, {"time": 60, "free": [5]}]},
}
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
@pytest.mark.parametrize("media_type", [JSON, ARROW])
@slow
@given(content=st.binary(max_size=200))
def test_any_bytes(kind: str, media_type: str, content: bytes) -> None:
    read(content, kind, media_type)

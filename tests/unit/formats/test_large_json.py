"""Large JSON posts: read in pieces, and to the same columns and errors as small ones."""

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tidemap.errors import DomainError, InvalidInputError, UnreadableBodyError
from tidemap.formats.json_columns import large, small
from tidemap.formats.json_columns import text as json_text
from tidemap.space.grid import SINGLE, GridGeometry

GRID = GridGeometry("map", (0.0, 0.0, 0.0), 1.0, (4, 5))
TIME = st.sampled_from([0, 1.5, -3, "2026-03-01T09:00:00Z", "17", 1e9])
CELL = st.integers(-1, 25) | st.lists(st.integers(-1, 6), min_size=2, max_size=2)
OBSERVATION = st.fixed_dictionaries({"time": TIME}, optional={"occupied": st.lists(CELL), "free": st.lists(CELL)})


def columns(read: Any, document: Any, grid: GridGeometry, indent: int | None) -> Any:
    try:
        found = read(json.dumps(document, indent=indent).encode(), grid)
    except DomainError as error:
        return type(error)
    return [each.tolist() for each in (found.time, np.asarray(found.cell), found.state)]


def both(document: Any, grid: GridGeometry, piece: int, indent: int | None) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(json_text, "PIECE_BYTES", piece)
        read = columns(large.read, document, grid, indent)
    assert read == columns(small.read, document, grid, indent)


@given(
    time=st.lists(TIME, max_size=20),
    state=st.lists(st.integers(0, 1), max_size=20),
    piece=st.integers(1, 40),
    indent=st.sampled_from([None, 1]),
)
def test_states_are_read_alike(time: list[Any], state: list[int], piece: int, indent: int | None) -> None:
    both({"time": time, "state": state}, SINGLE, piece, indent)
    n = min(len(time), len(state))
    both({"time": time[:n], "state": state[:n]}, SINGLE, piece, indent)


@given(observations=st.lists(OBSERVATION, max_size=5), piece=st.integers(1, 40), indent=st.sampled_from([None, 1]))
def test_observations_are_read_alike(observations: list[dict[str, Any]], piece: int, indent: int | None) -> None:
    both({"observations": observations}, GRID, piece, indent)


@pytest.mark.parametrize(
    ("content", "grid", "error", "says"),
    [
        (b'{"time": [1], "state": [1], "sate": 1}', SINGLE, InvalidInputError, "sate: this field is not known"),
        (b'{"time": [1]}', SINGLE, InvalidInputError, "state: this field is missing"),
        (b'{"observations": [{"time": 1}, {"tiem": 1}]}', GRID, InvalidInputError, "observations[1].tiem"),
        (b'{"observations": [{"time": 1}, {}]}', GRID, InvalidInputError, "observations[1].time"),
        (b'{"observations": 1}', GRID, InvalidInputError, "observations: expected `array`"),
        (b'{"time": [1, NaN], "state": [1, 1]}', SINGLE, UnreadableBodyError, "no JSON"),
        (b"[1]", SINGLE, UnreadableBodyError, "no JSON object"),
        (b'{"time": ["\xff"], "state": [1]}', SINGLE, UnreadableBodyError, "no JSON"),
        (
            b'{"observations": [%s]}' % b",".join([b'{"time":1}'] * 100_001),
            GRID,
            InvalidInputError,
            "100000 observations",
        ),
    ],
)
def test_what_is_wrong_is_said(content: bytes, grid: GridGeometry, error: type[DomainError], says: str) -> None:
    with pytest.raises(error) as raised:
        large.read(content, grid)
    assert says in str(raised.value)


def test_a_wrong_item_is_named_by_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(json_text, "PIECE_BYTES", 8)
    for document, location in (
        ({"time": [*range(50), "noon"], "state": [1] * 51}, "time[50]"),
        ({"time": [1] * 51, "state": [*[1] * 50, 0.5]}, "state[50]"),
    ):
        with pytest.raises(InvalidInputError) as raised:
            large.read(json.dumps(document).encode(), SINGLE)
        assert location in str(raised.value)

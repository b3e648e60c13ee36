"""Bodies of observations: what they mean, and what is said about those that are wrong."""

import json
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.parsing import Target, parse
from tidemap.errors import DomainError, InvalidInputError, UnreadableBodyError, UnsupportedMediaTypeError
from tidemap.formats.registry import Body
from tidemap.history.measurements import Measurements
from tidemap.media_types import ARROW, JSON
from tidemap.space.grid import SINGLE, GridGeometry

GRID = GridGeometry("map", (0.0, 0.0, 0.0), 0.1, (4, 3, 2))
LATEST = 2e9
STATE = Target(SINGLE, LATEST)
SPACE = Target(GRID, LATEST)
FLAT = Target(GridGeometry("map", (0.0, 0.0, 0.0), 0.1, (4, 3)), LATEST)


def rows(measurements: Measurements) -> list[tuple[float, int, int]]:
    columns = (measurements.time, measurements.cell, measurements.state)
    assert [column.dtype for column in columns] == [np.float64, np.uint32, np.uint8]
    return list(zip(*(column.tolist() for column in columns), strict=True))


def from_json(document: Any, target: Target) -> list[tuple[float, int, int]]:
    content = document if isinstance(document, bytes) else json.dumps(document).encode()
    return rows(parse(Body(content, JSON), target))


def stream(columns: dict[str, Any], **options: Any) -> bytes:
    table = pa.table(columns)
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema, options=pa.ipc.IpcWriteOptions(**options)) as writer:
        writer.write_table(table, max_chunksize=3)
    return bytes(sink.getvalue())


def from_arrow(columns: dict[str, Any], target: Target) -> list[tuple[float, int, int]]:
    return rows(parse(Body(stream(columns), ARROW), target))


def test_a_state_is_two_columns() -> None:
    document = {"time": [1.5, "1970-01-01T00:01:00Z", "1970-01-01T01:02:00+01:00", 1], "state": [0, 1, 1, 0]}
    assert from_json(document, STATE) == [(1.0, 0, 0), (1.5, 0, 0), (60.0, 0, 1), (120.0, 0, 1)]


def test_a_grid_is_a_list_of_looks() -> None:
    document = {
        "observations": [
            {"time": 5, "occupied": [23, [0, 0, 1]], "free": [[3, 2, 0]]},
            {"time": "1970-01-01T00:00:06Z", "free": [0]},
            {"time": 7},
        ]
    }
    assert from_json(document, SPACE) == [(5.0, 1, 1), (5.0, 22, 0), (5.0, 23, 1), (6.0, 0, 0)]
    assert from_json({"observations": [{"time": 5, "occupied": [[3, 2], 0]}]}, FLAT) == [(5.0, 0, 1), (5.0, 11, 1)]


TIMES = [1.0, 2.25, -3.0, 1.7e9]


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_arrow_timestamps_are_times(unit: str) -> None:
    ticks = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[unit]
    whole = [int(time) for time in TIMES]
    column = pa.array([time * ticks for time in whole], pa.timestamp(unit, tz="Europe/London"))
    assert [time for time, _, _ in from_arrow({"time": column, "state": [0, 1, 0, 1]}, STATE)] == sorted(whole)


@pytest.mark.parametrize("kind", [pa.uint8(), pa.bool_(), pa.int8(), pa.int64(), pa.uint64()])
def test_arrow_states_are_integers_or_booleans(kind: Any) -> None:
    states = pa.array([1, 0, 0, 1]).cast(kind)
    cells = pa.array([0, 5, 23, 23], pa.uint32())
    expected = sorted(zip(TIMES, [0, 5, 23, 23], [1, 0, 0, 1], strict=True))
    assert from_arrow({"time": TIMES, "cell": cells, "state": states}, SPACE) == expected


@given(
    st.lists(
        st.tuples(st.floats(-1e9, 1e9), st.integers(0, 23), st.integers(0, 1)),
        min_size=1,
        unique_by=lambda row: row[:2],
    )
)
@settings(max_examples=40)
def test_json_and_arrow_say_the_same(given_rows: list[tuple[float, int, int]]) -> None:
    looks = [{"time": time, ("free", "occupied")[state]: [cell]} for time, cell, state in given_rows]
    time, cell, state = zip(*given_rows, strict=True)
    arrow = from_arrow({"time": time, "cell": pa.array(cell, pa.uint32()), "state": pa.array(state, pa.uint8())}, SPACE)
    assert from_json({"observations": looks}, SPACE) == arrow == sorted(given_rows)


def test_iso_times_are_exact() -> None:
    moment = datetime(2026, 3, 1, 9, 0, 0, 123456, UTC)
    assert from_json({"time": [moment.isoformat()], "state": [1]}, STATE)[0][0] == moment.timestamp()


def look(**changes: Any) -> dict[str, Any]:
    return {"observations": [{"time": 1, "occupied": [1]}, {"time": 2, "free": [2, 3], **changes}]}


@pytest.mark.parametrize(
    ("document", "target", "field", "advice"),
    [
        ([], STATE, "body", "send a JSON object"),
        ({"time": [1]}, STATE, "state", "missing"),
        ({"time": [1], "state": [1], "cell": [0]}, STATE, "cell", "not known; known are state, time"),
        ({"time": 1, "state": [1]}, STATE, "time", "send a list"),
        ({"time": [1, 2], "state": [1]}, STATE, "state", "1 values and time has 2"),
        ({"time": [], "state": []}, STATE, "time", "at least one"),
        ({"time": [1, "2026-03-01T09:00:00"], "state": [1, 1]}, STATE, "time[1]", "no time zone; append Z"),
        ({"time": [1, "noon"], "state": [1, 1]}, STATE, "time[1]", "no ISO 8601 time"),
        ({"time": [1, None], "state": [1, 1]}, STATE, "time[1]", "give Unix seconds"),
        ({"time": [1, True], "state": [1, 1]}, STATE, "time[1]", "give Unix seconds"),
        ({"time": [1, [2]], "state": [1, 1]}, STATE, "time[1]", "give Unix seconds"),
        ({"time": [1, 2e9 + 1], "state": [1, 1]}, STATE, "time[1]", "too far in the future"),
        ({"time": [1, 1.7e12], "state": [1, 1]}, STATE, "time[1]", "too far in the future"),
        ({"time": [1, -1e12], "state": [1, 1]}, STATE, "time[1]", "no Unix time"),
        ({"time": [1, 2], "state": [1, 2]}, STATE, "state[1]", "0 (free) or 1 (occupied)"),
        ({"time": [1, 2], "state": [1, 0.5]}, STATE, "state[1]", "0 (free) or 1 (occupied)"),
        ({"time": [1, 2], "state": [None, 2]}, STATE, "state[1]", "0 (free) or 1 (occupied)"),
        ({"time": [1, 2], "state": [1, 2**80]}, STATE, "state[1]", "0 (free) or 1 (occupied)"),
        ({"observations": {}}, SPACE, "observations", "send a list"),
        ({"observations": []}, SPACE, "observations", "at least one"),
        ({"observations": [{"time": 1}]}, SPACE, "observations", "at least one"),
        ({"observations": [7]}, SPACE, "observations[0]", "send an object"),
        (look(hit=[1]), SPACE, "observations[1].hit", "known are free, occupied, time"),
        (look(time="soon"), SPACE, "observations[1].time", "no ISO 8601"),
        (look(time=3e9), SPACE, "observations[1].time", "too far in the future"),
        (look(occupied=5), SPACE, "observations[1].occupied", "send a list"),
        (look(occupied=[0, 24]), SPACE, "observations[1].occupied[1]", "cells are 0 to 23"),
        (look(occupied=[0, -1]), SPACE, "observations[1].occupied[1]", "cells are 0 to 23"),
        (look(occupied=[[0, 0, 0], [4, 0, 0]]), SPACE, "observations[1].occupied[1]", "cells are 0 to 23"),
        (look(occupied=[[0, 0, 0], [0, 0]]), SPACE, "observations[1].occupied", "lists of 3 whole numbers"),
        (look(occupied=[[0, 0, 0.5]]), SPACE, "observations[1].occupied", "lists of 3 whole numbers"),
        (look(occupied=[[0, 0, True]]), SPACE, "observations[1].occupied", "lists of 3 whole numbers"),
        (look(occupied=[0, 1.5]), SPACE, "observations[1].occupied[1]", "linear index or [i,j,k]"),
        (look(occupied=[0, "1"]), SPACE, "observations[1].occupied[1]", "linear index or [i,j,k]"),
        (look(occupied=[0, True]), SPACE, "observations[1].occupied[1]", "linear index or [i,j,k]"),
        (look(occupied=[[0, 0, 0], None]), SPACE, "observations[1].occupied[1]", "linear index or [i,j,k]"),
        (look(occupied=[2]), SPACE, "observations[1].free[0]", "both occupied and free"),
    ],
)
def test_what_is_wrong_is_named_with_what_to_change(document: Any, target: Target, field: str, advice: str) -> None:
    with pytest.raises(InvalidInputError) as caught:
        from_json(document, target)
    assert caught.value.errors[0].field == field
    assert advice in caught.value.errors[0].message


def test_every_unknown_and_missing_field_is_named_at_once() -> None:
    with pytest.raises(InvalidInputError) as caught:
        from_json({"times": [1], "states": [1]}, STATE)
    assert [error.field for error in caught.value.errors] == ["times", "states", "state", "time"]


@pytest.mark.parametrize(
    ("content", "field"),
    [
        (b'{"time": [1, NaN], "state": [0, 1]}', "time[1]"),
        (b'{"time": [1], "state": [-Infinity]}', "state[0]"),
        (b'{"observations": [{"time": 1, "free": [0, NaN]}]}', "observations[0].free[1]"),
    ],
)
def test_nan_and_infinity_are_named_where_they_stand(content: bytes, field: str) -> None:
    with pytest.raises(InvalidInputError, match="NaN and infinity") as caught:
        from_json(content, STATE)
    assert caught.value.errors[0].field == field


@pytest.mark.parametrize("content", [b"", b"{", b"\xff\xfe", b'{"time": [1,]}', b"[" * 100_000, b"nul"])
def test_what_is_no_json_is_unreadable(content: bytes) -> None:
    with pytest.raises(UnreadableBodyError, match="no JSON"):
        from_json(content, STATE)


@pytest.mark.parametrize(
    ("columns", "target", "field", "advice"),
    [
        ({"time": [1.0]}, STATE, "state", "missing"),
        ({"time": [1.0], "state": [1], "cell": [0]}, STATE, "cell", "not known here; send state, time"),
        ({"time": [1.0], "state": [1]}, SPACE, "cell", "missing"),
        ({"time": pa.array([1], pa.timestamp("s")), "state": [1]}, STATE, "time", "no zone"),
        ({"time": ["1970-01-01T00:00:00Z"], "state": [1]}, STATE, "time", "send float64"),
        ({"time": [1.0], "state": ["on"]}, STATE, "state", "send uint8 or bool"),
        ({"time": [1.0, 2.0], "state": [1.0, 0.5]}, STATE, "state[1]", "0 (free) or 1 (occupied)"),
        ({"time": [1.0], "cell": [1.0], "state": [1]}, SPACE, "cell", "send uint32"),
        ({"time": [1.0, None], "state": [1, 0]}, STATE, "time", "nulls"),
        ({"time": [1.0, float("nan")], "state": [1, 0]}, STATE, "time[1]", "NaN and infinity"),
        ({"time": [1.0, float("inf")], "state": [1, 0]}, STATE, "time[1]", "NaN and infinity"),
        ({"time": [1.0, 1.0], "cell": [0, 24], "state": [1, 0]}, SPACE, "cell[1]", "cells are 0 to 23"),
        (
            {"time": [1.0], "cell": pa.array([2**64 - 1], pa.uint64()), "state": [1]},
            SPACE,
            "cell[0]",
            "cells are 0 to 23",
        ),
        ({"time": [1.0, 2.0], "state": [1, -1]}, STATE, "state[1]", "0 (free) or 1 (occupied)"),
        ({"time": [1.0, 1.0], "cell": [5, 5], "state": [1, 0]}, SPACE, "cell[1]", "both occupied and free"),
        ({"time": pa.array([], pa.float64()), "state": pa.array([], pa.uint8())}, STATE, "time", "at least one"),
    ],
)
def test_what_is_wrong_in_arrow_is_named_too(columns: dict[str, Any], target: Target, field: str, advice: str) -> None:
    with pytest.raises(InvalidInputError) as caught:
        from_arrow(columns, target)
    assert caught.value.errors[0].field == field
    assert advice in caught.value.errors[0].message


def test_arrow_that_is_cut_or_packed_is_unreadable() -> None:
    columns = {"time": TIMES, "state": [0, 1, 0, 1]}
    whole = stream(columns)
    for content in (b"", b"ARROW1", whole[:50], whole[: len(whole) // 2], b"{}"):
        with pytest.raises(UnreadableBodyError):
            parse(Body(content, ARROW), STATE)
    with pytest.raises(UnreadableBodyError, match="compressed"):
        parse(Body(stream({"time": [1.0] * 9999, "state": [1] * 9999}, compression="zstd"), ARROW), STATE)


def test_other_kinds_of_bodies_are_refused_by_name() -> None:
    with pytest.raises(UnsupportedMediaTypeError, match="'text/csv' is not read here; send one of application/json"):
        parse(Body(b"1,1", "text/csv"), STATE)


def test_a_long_text_among_numbers_costs_no_memory() -> None:
    """numpy would give each of the 100,000 rows the room of the longest text: 8 GB."""
    import tracemalloc

    content = json.dumps({"time": ["x" * 20_000, *[1] * 100_000], "state": [1] * 100_001}).encode()
    tracemalloc.start()
    with pytest.raises(InvalidInputError):
        from_json(content, STATE)
    assert tracemalloc.get_traced_memory()[1] < 50e6
    tracemalloc.stop()


ODD = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.just("2026-03-01T09:00:00Z"),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from(["time", "free", "x"]), inner, max_size=3)
    ),
    max_leaves=8,
)
LISTS = st.lists(ODD | st.integers(0, 30), max_size=5) | ODD
DOCUMENTS = (
    st.fixed_dictionaries({"time": LISTS, "state": LISTS})
    | st.fixed_dictionaries(
        {
            "observations": st.lists(
                st.fixed_dictionaries({"time": ODD | st.integers(0, 9)}, optional={"occupied": LISTS, "free": LISTS}),
                max_size=3,
            )
        }
    )
    | ODD
)


@given(DOCUMENTS, st.sampled_from([STATE, SPACE, FLAT]))
@settings(max_examples=300)
def test_odd_documents_are_parsed_or_refused_in_our_words(document: Any, target: Target) -> None:
    try:
        measured = from_json(document, target)
    except DomainError:
        return
    assert measured
    assert all(cell < target.grid.n_cells and state in (0, 1) and time <= LATEST for time, cell, state in measured)


@given(st.binary(max_size=60), st.integers(0, 10**6), st.sampled_from([STATE, SPACE]))
@settings(max_examples=300)
def test_damaged_arrow_is_parsed_or_refused_in_our_words(noise: bytes, location: int, target: Target) -> None:
    columns = {"time": TIMES, "cell": pa.array([0, 1, 2, 3], pa.uint32()), "state": [0, 1, 0, 1]}
    if target is STATE:
        del columns["cell"]
    whole = stream(columns)
    start = location % len(whole)
    content = whole[:start] + noise + whole[start + len(noise) :]
    try:
        measured = rows(parse(Body(content, ARROW), target))
    except DomainError:
        return
    assert all(cell < target.grid.n_cells and state in (0, 1) for _, cell, state in measured)

"""Measurements as columns, batches and Arrow."""

import io

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tidemap.client import arrow, npy
from tidemap.client.encoding import PostedColumns, batches, measurements, snapshot, snapshots, table
from tidemap.formats.registry import Body, read
from tidemap.history.measurements import UNAVAILABLE
from tidemap.ingest.observation import Target, checked
from tidemap.media_types import JSON
from tidemap.space.grid import SINGLE, GridGeometry


def joined(parts: list[PostedColumns]) -> tuple[list[float], list[int], list[int]]:
    time = [t for part in parts for t in part.time.tolist()]
    cell = [c for part in parts if part.cell is not None for c in part.cell.tolist()]
    return time, cell, [s for part in parts for s in part.state.tolist()]


@given(st.lists(st.integers(0, 6), max_size=60), st.integers(1, 12))
def test_batches_lose_and_reorder_nothing_and_keep_within_the_limit(times: list[int], most: int) -> None:
    columns = measurements(np.sort(times), np.arange(len(times)) % 2, np.arange(len(times)))
    parts = list(batches(columns, most))
    assert joined(parts) == joined([columns])
    assert all(len(part) <= most for part in parts)
    assert all(len(part) for part in parts) or len(columns) == 0


@given(st.lists(st.integers(1, 5), min_size=1, max_size=12))
def test_a_look_that_fits_a_batch_is_not_cut(sizes: list[int]) -> None:
    time = np.repeat(np.arange(len(sizes)), sizes)
    columns = measurements(time, np.zeros(len(time)), np.arange(len(time)))
    seen = [set(part.time.tolist()) for part in batches(columns, 5)]
    assert sum(len(times) for times in seen) == len(sizes)


def test_nothing_is_still_one_post() -> None:
    assert [len(part) for part in batches(measurements([], []))] == [0]


def test_columns_come_in_order_of_time_and_ties_keep_their_order() -> None:
    columns = measurements([2, 1, 1], [1, 0, 1], [7, 8, 9])
    assert columns.cell is not None
    assert (columns.time.tolist(), columns.cell.tolist(), columns.state.tolist()) == (
        [1, 1, 2],
        [8, 9, 7],
        [0, 1, 1],
    )


def test_one_time_serves_all_measurements() -> None:
    assert measurements(3, [1, 0], [4, 5]).time.tolist() == [3, 3]


def test_columns_of_different_length_are_refused() -> None:
    with pytest.raises(ValueError, match=r"columns differ in length.*'state': 3"):
        measurements([1, 2], [0, 1, 0])
    with pytest.raises(ValueError, match=r"'cell': 1"):
        measurements([1, 2], [0, 1], [5])


@pytest.mark.parametrize("bad", [[-1], [0.5], [2**32], [float("nan")], [[1, 2]]])
def test_cells_that_would_change_by_packing_are_refused(bad: list[float]) -> None:
    with pytest.raises(ValueError, match="cell is a column of whole numbers"):
        measurements(0, [1], bad)


def test_a_look_marks_occupied_and_free() -> None:
    columns = snapshot(5, np.array([3, 4]), np.array([9]))
    assert columns.cell is not None
    assert dict(zip(columns.cell.tolist(), columns.state.tolist(), strict=True)) == {3: 1, 4: 1, 9: 0}


@pytest.mark.parametrize("cell", [None, [7, 8]])
def test_arrow_has_the_columns_of_the_contract(cell: list[int] | None) -> None:
    table = pa.ipc.open_stream(arrow.write(measurements([1.5, 2], [True, False], cell).named())).read_all()
    assert table.column("time").to_pylist() == [1.5, 2]
    assert table.column("state").to_pylist() == [1, 0]
    assert (table.schema.field("time").type, table.schema.field("state").type) == (pa.float64(), pa.uint8())
    if cell is None:
        assert "cell" not in table.column_names
    else:
        assert table.column("cell").to_pylist() == cell
        assert table.schema.field("cell").type == pa.uint32()


@pytest.mark.parametrize("time", [np.float32(1795874165.3), np.array([1795874165.3], np.float32), np.float16(3)])
def test_times_too_coarse_for_a_second_are_refused(time: object) -> None:
    with pytest.raises(ValueError, match="too coarse for Unix seconds"):
        measurements(time, [1])  # type: ignore[arg-type]


@pytest.mark.parametrize("state", [["on"], ["1"], [None, "1"]])
def test_a_state_that_is_no_number_is_named(state: list[object]) -> None:
    with pytest.raises(ValueError, match="state is a column of numbers"):
        measurements([0.0], state)


def test_a_time_in_a_list_is_for_one_state_and_a_time_alone_for_all() -> None:
    with pytest.raises(ValueError, match="columns differ in length"):
        measurements([0.0], [0, 1])
    assert measurements(5.0, [0, 1]).time.tolist() == [5.0, 5.0]


@pytest.mark.parametrize("cell", [None, [3, 4]])
def test_rows_of_a_table_are_what_the_server_reads(cell: list[int] | None) -> None:
    table = np.load(io.BytesIO(npy.write_rows(measurements([1.0, 2.0], [1, 0], cell).named())))
    assert table.dtype.names == (("time", "state") if cell is None else ("time", "cell", "state"))
    assert table["time"].tolist() == [1.0, 2.0]
    assert cell is None or table["cell"].tolist() == cell


@pytest.mark.parametrize("state", [[1, None, 0], [1.0, np.nan, 0.0], np.array([1, None, False], object)])
@pytest.mark.parametrize("cell", [None, [2, 1, 0]])
def test_a_sensor_that_is_unavailable_says_so_in_every_form(
    state: object, cell: list[int] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    grid = SINGLE if cell is None else GridGeometry("", (0.0, 0.0, 0.0), 1.0, (3, 1))
    columns = measurements([0.0, 60.0, 120.0], state, cell)
    sent = [table(columns)]
    monkeypatch.setattr(arrow, "pa", None)
    sent.append(table(columns))
    if cell is not None:
        sent.append((JSON, snapshots(columns, np.array([[0, 0], [1, 0], [2, 0]]))))
    assert len({kind for kind, _ in sent}) == len(sent)
    for kind, content in sent:
        found = checked(read(Body(content, kind), grid), Target(grid, -1e9, 1e9))
        assert (found.time.tolist(), found.state.tolist()) == ([0.0, 60.0, 120.0], [1, UNAVAILABLE, 0])
        assert found.cell.tolist() == (cell or [0, 0, 0])

"""Measurements as bytes: batches of columns, each a table, or JSON where cells are rows of indices."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tidemap.client import arrow, npy
from tidemap.client.times import TimesLike, is_single, unix_array
from tidemap.media_types import ARROW, NPY

MEASUREMENTS_PER_POST = 200_000
"""2.6 MB a post: small enough to try again, large enough that the request itself costs nothing."""

Numbers: TypeAlias = Sequence[int] | Sequence[Sequence[int]] | NDArray[Any]


@dataclass(frozen=True, slots=True, eq=False)
class PostedColumns:
    """time (n,) float64 Unix seconds, ascending; state (n,) uint8; cell (n,) uint32 or None (`state`).

    Where a sensor is unavailable in some rows, state is float32, and NaN there.
    """

    time: NDArray[np.float64]
    state: NDArray[np.uint8] | NDArray[np.float32]
    cell: NDArray[np.uint32] | None

    def __len__(self) -> int:
        return len(self.time)

    def named(self) -> dict[str, NDArray[Any]]:
        """The columns by name."""
        cell = {} if self.cell is None else {"cell": self.cell}
        return {"time": self.time, **cell, "state": self.state}

    def part(self, start: int, stop: int) -> "PostedColumns":
        """The measurements [start, stop)."""
        cell = None if self.cell is None else self.cell[start:stop]
        return PostedColumns(self.time[start:stop], self.state[start:stop], cell)


def measurements(time: TimesLike, state: Any, cell: Any = None) -> PostedColumns:
    """Columns in order of time; one time for all is repeated, a state None or NaN says that its sensor is unavailable.

    Raises ValueError where lengths differ.
    """
    states = _states(state)
    cells = None if cell is None else _small(cell, "cell", np.uint32)
    times = unix_array(time)
    if is_single(time):
        times = np.repeat(times, len(states))
    lengths = {"time": len(times), "state": len(states)} | ({} if cells is None else {"cell": len(cells)})
    if len(set(lengths.values())) > 1:
        raise ValueError(f"columns differ in length: {lengths}")
    return _in_order(PostedColumns(times, states, cells))


def snapshot(time: TimesLike, occupied: NDArray[Any], free: NDArray[Any]) -> PostedColumns:
    """A grid at one time: cells seen occupied (m,) and cells seen free (k,)."""
    state = np.repeat(np.array([1, 0], np.uint8), [len(occupied), len(free)])
    return measurements(time, state, np.concatenate([occupied, free]))


def batches(columns: PostedColumns, most: int = MEASUREMENTS_PER_POST) -> Iterator[PostedColumns]:
    """Consecutive parts of at most `most` measurements, cut between snapshots where that is possible.

    There is always one, so that what an empty post means is left to the server.
    """
    starts = np.flatnonzero(np.diff(columns.time)) + 1
    start = 0
    while len(columns) - start > most:
        last = np.searchsorted(starts, start + most, side="right") - 1
        whole = int(starts[last]) if last >= 0 else 0
        stop = whole if whole > start else start + most
        yield columns.part(start, stop)
        start = stop
    yield columns.part(start, len(columns))


def table(columns: PostedColumns) -> tuple[str, bytes]:
    """The columns as bytes of a media type: an Arrow IPC stream, or npy where pyarrow is not installed."""
    named = columns.named()
    return (NPY, npy.write_rows(named)) if arrow.pa is None else (ARROW, arrow.write(named))


def snapshots(columns: PostedColumns, rows: NDArray[np.int64]) -> bytes:
    """The JSON form of snapshots at a grid; `columns.cell` counts into `rows` (m, 2 or 3), the cells [i, j, k].

    It needs no shape and so no server. Raises ValueError for a state that it cannot say.
    """
    if columns.cell is None or (columns.state > 1).any():
        raise ValueError("a state is 0 (free) or 1 (occupied)")
    cuts = np.flatnonzero(np.diff(columns.time)) + 1
    parts = (np.split(column, cuts) for column in (columns.time, columns.state, rows[columns.cell]))
    observations = [
        {"time": time[0], "occupied": row[state == 1].tolist(), "free": row[state == 0].tolist()}
        | ({"unavailable": row[np.isnan(state)].tolist()} if np.isnan(state).any() else {})
        for time, state, row in zip(*parts, strict=True)
        if len(time)
    ]
    return json.dumps({"observations": observations}, separators=(",", ":")).encode()


def tristate(states: Any) -> NDArray[np.int8]:
    """States 1, 0 and -1 (or 255) for not seen, of any shape. Raises ValueError for any other.

    >>> tristate([[0, 1], [255, -1]]).tolist()
    [[0, 1], [-1, -1]]
    """
    array = np.asarray(states)
    if not np.isin(array, (0, 1, 255, -1)).all():
        raise ValueError("a state is 0 (free), 1 (occupied), or -1 (not seen)")
    return np.where(array == 255, -1, array).astype(np.int8)


def indices(cells: Any) -> NDArray[np.int64]:
    """Rows of indices (n, 2 or 3) into a grid. Raises ValueError for what is no whole number."""
    array = np.asarray(cells)
    rows = array.astype(np.int64)
    if not np.array_equal(rows, array) or (rows < 0).any():
        raise ValueError("a row of indices [i, j, k] is of whole numbers from 0")
    return rows


def _states(values: Any) -> NDArray[np.uint8] | NDArray[np.float32]:
    """States (n,) as in PostedColumns. Raises ValueError."""
    array = np.atleast_1d(np.asarray(values))
    if array.dtype.kind == "O":
        missing = np.array([value is None or value != value for value in array.flat], np.bool_).reshape(array.shape)
    else:
        missing = np.isnan(array) if array.dtype.kind == "f" else np.zeros(array.shape, np.bool_)
    if not missing.any():
        return _small(values, "state", np.uint8)
    filled = np.array(np.where(missing, 0, array).tolist())
    return np.where(missing, np.float32(np.nan), _small(filled, "state", np.uint8)).astype(np.float32)


def _small(values: Any, name: str, dtype: type[np.unsignedinteger[Any]]) -> NDArray[Any]:
    """`values` (n,) as an unsigned type. Raises ValueError for what would change by it."""
    array = np.atleast_1d(np.asarray(values))
    if array.size == 0:
        return np.zeros(0, dtype)
    if array.dtype.kind not in "biuf":
        raise ValueError(f"{name} is a column of numbers; {array.flat[0]!r} is none")
    with np.errstate(invalid="ignore"):
        small = array.astype(dtype)
    if array.ndim != 1 or not np.array_equal(small, array):
        raise ValueError(f"{name} is a column of whole numbers from 0 to {np.iinfo(dtype).max}")
    return small


def _in_order(columns: PostedColumns) -> PostedColumns:
    if (np.diff(columns.time) >= 0).all():
        return columns
    order = np.argsort(columns.time, kind="stable")
    cell = None if columns.cell is None else columns.cell[order]
    return PostedColumns(columns.time[order], columns.state[order], cell)

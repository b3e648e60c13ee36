"""Answers about a map as numpy arrays."""

import json
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from tidemap.schemas.common import parse_time

UNKNOWN = -1
"""In integer arrays: never observed, or not observed then."""

Column: TypeAlias = Literal["probability", "state", "observed", "observed_time"]


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """time (n_times,) Unix seconds; cell (n_cells,); the others (n_cells, n_times).

    A cell never observed has probability and entropy NaN and state -1. So do those that are `unavailable`: (m, 2)
    ranges [first, stop) of cells whose stored state is damaged, none when all is well at the server.
    """

    time: NDArray[np.float64]
    cell: NDArray[np.int64]
    probability: NDArray[np.float32]
    state: NDArray[np.int8]
    entropy: NDArray[np.float32]
    confidence: float
    revision: int
    unavailable: NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """One cell over time: all (n,). state and observed are -1 where nothing is known."""

    cell: int
    time: NDArray[np.float64]
    probability: NDArray[np.float32]
    state: NDArray[np.int8]
    observed: NDArray[np.int8]
    revision: int


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """The map at `time` (Unix seconds), for the cells ever observed: arrays (n,), cell linear in C order.

    `unavailable` (m, 2) are ranges [first, stop) of cells that are missing because their stored state is damaged.
    `observed` (-1: not yet observed then) and `observed_time` (NaN) are None unless they were asked for.
    """

    time: float
    confidence: float
    estimator: str
    order: int
    revision: int
    shape: tuple[int, ...]
    cell: NDArray[np.int64]
    probability: NDArray[np.float32]
    state: NDArray[np.int8]
    verdict: NDArray[np.str_]
    unavailable: NDArray[np.int64]
    observed: NDArray[np.int8] | None = None
    observed_time: NDArray[np.float64] | None = None

    def dense(self, column: Column = "probability") -> NDArray[Any]:
        """A column as a grid of `shape`; NaN (integers: -1) where a cell was never observed.

        Raises ValueError for a column that was not asked for.
        """
        values = getattr(self, column)
        if values is None:
            raise ValueError(f"{column} was not asked for; call state(observed=True)")
        unknown = UNKNOWN if values.dtype.kind == "i" else np.nan
        grid = np.full(int(np.prod(self.shape)), unknown, values.dtype)
        grid[self.cell] = values
        return grid.reshape(self.shape)


def prediction(content: bytes) -> Prediction:
    """The answer of `/predict`."""
    said = json.loads(content)
    shape = (len(said["cell"]), len(said["time"]))
    return Prediction(
        np.array(said["time"], np.float64),
        np.array(said["cell"], np.int64),
        _floats(said["probability"]).reshape(shape),
        _states(said["state"]).reshape(shape),
        _floats(said["entropy"]).reshape(shape),
        said["confidence"],
        said["revision"],
        _ranges(said["unavailable"]),
    )


def series(content: bytes) -> Series:
    """The answer of `/series`."""
    said = json.loads(content)
    return Series(
        said["cell"],
        np.array(said["time"], np.float64),
        _floats(said["probability"]),
        _states(said["state"]),
        _states(said["observed"]),
        said["revision"],
    )


def state(content: bytes) -> State:
    """The answer of `/state` as an Arrow IPC stream; its schema carries the rest as JSON under `tidemap`."""
    with pa.ipc.open_stream(pa.py_buffer(content)) as stream:
        table = stream.read_all()
    said = json.loads(table.schema.metadata[b"tidemap"])
    columns = set(table.column_names)
    return State(
        time=parse_time(said["time"]),
        confidence=said["confidence"],
        estimator=said["estimator"],
        order=said["order"],
        revision=said["revision"],
        shape=tuple(said["shape"]),
        cell=_column(table, "cell", np.int64),
        probability=_column(table, "probability", np.float32),
        state=_column(table, "state", np.int8),
        verdict=_texts(table.column("verdict")),
        unavailable=_ranges(said["unavailable"]),
        observed=_column(table, "observed", np.int8) if "observed" in columns else None,
        observed_time=_column(table, "observed_time", np.float64) if "observed_time" in columns else None,
    )


def _ranges(values: Any) -> NDArray[np.int64]:
    return np.array(values, np.int64).reshape(-1, 2)


def _floats(values: Any) -> NDArray[np.float32]:
    """Numbers with null for NaN."""
    return np.array(values, np.float64).astype(np.float32)


def _states(values: Any) -> NDArray[np.int8]:
    """0, 1 and null, which becomes -1."""
    return np.nan_to_num(np.array(values, np.float64), nan=UNKNOWN).astype(np.int8)


def _column(table: pa.Table, name: str, dtype: type[np.number[Any]]) -> NDArray[Any]:
    values: NDArray[Any] = table.column(name).to_numpy()
    if values.dtype.kind == "f" and not np.issubdtype(dtype, np.floating):
        values = np.nan_to_num(values, nan=UNKNOWN)
    return values.astype(dtype, copy=False)


def _texts(column: pa.ChunkedArray) -> NDArray[np.str_]:
    """A column of few different texts, plain or dictionary-encoded."""
    array = column.combine_chunks()
    if not pa.types.is_dictionary(array.type):
        array = array.dictionary_encode()
    words = np.array(array.dictionary.to_pylist() or [""], np.str_)
    chosen: NDArray[np.str_] = words[array.indices.to_numpy(zero_copy_only=False).astype(np.int64)]
    return chosen

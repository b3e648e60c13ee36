"""Arrow observations: an IPC stream with columns `time`, `cell` (not for kind `state`) and `state`."""

from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from app.errors import FieldError, InvalidInputError, UnreadableBodyError
from app.ingest.columns import Columns, narrow_states
from app.space.grid import Grid


def read(content: bytes, kind: str, grid: Grid) -> Columns:
    """Columns of an Arrow IPC stream. Raises UnreadableBodyError, InvalidInputError."""
    del grid
    table = _load(content)
    _check_columns(table, {"time", "state"} if kind == "state" else {"time", "cell", "state"})
    times = _times(table.column("time"))
    cells = np.zeros(len(times), np.int64) if kind == "state" else _integers(table.column("cell"), "cell")
    states = _integers(table.column("state"), "state")
    return Columns(
        times, cells, narrow_states(states), "time[{}]".format, "cell[{}]".format, "state[{}]".format, "time"
    )


def _load(content: bytes) -> Any:
    try:
        with pa.ipc.open_stream(pa.py_buffer(content)) as reader:
            table = reader.read_all()
        table.validate(full=True)
    except (pa.ArrowException, OSError, ValueError, EOFError, MemoryError) as error:
        raise UnreadableBodyError(f"The body is no Arrow IPC stream: {error}") from None
    return table


def _check_columns(table: Any, wanted: set[str]) -> None:
    names = list(table.column_names)
    errors = [
        FieldError(name, f"this column is not known here; send {', '.join(sorted(wanted))}")
        for name in dict.fromkeys(names)
        if name not in wanted
    ]
    errors += [FieldError(name, "this column is missing") for name in sorted(wanted - set(names))]
    errors += [FieldError(name, "this column stands twice") for name in sorted(wanted) if names.count(name) > 1]
    errors += [
        FieldError(name, "it has nulls; send every value")
        for name in sorted(wanted & set(names))
        if names.count(name) == 1 and table.column(name).null_count
    ]
    if errors:
        raise InvalidInputError(*errors)


def _times(column: Any) -> NDArray[np.float64]:
    kind = column.type
    if pa.types.is_timestamp(kind):
        if kind.tz is None:
            raise InvalidInputError.at(
                "time", "these timestamps have no zone; send timestamps with tz, or Unix seconds"
            )
        unit = {"s": 1, "ms": 1e3, "us": 1e6, "ns": 1e9}[kind.unit]
        return np.asarray(column.cast(pa.int64()).to_numpy() / unit, np.float64)
    if pa.types.is_floating(kind) or pa.types.is_integer(kind):
        return np.asarray(column.to_numpy(), np.float64)
    raise InvalidInputError.at("time", f"its type is {kind}; send float64 Unix seconds or timestamps with a zone")


def _integers(column: Any, field: str) -> NDArray[np.int64]:
    kind = column.type
    if pa.types.is_boolean(kind):
        column = column.cast(pa.uint8())
    elif not pa.types.is_integer(kind):
        raise InvalidInputError.at(
            field, f"its type is {kind}; send {'uint8 or bool' if field == 'state' else 'uint32'}"
        )
    values = column.to_numpy()
    if values.dtype == np.uint64 and (values > np.iinfo(np.int64).max).any():
        raise InvalidInputError.at(field, "a value is too large")
    return np.asarray(values, np.int64)

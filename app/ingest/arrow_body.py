"""Arrow observations: an IPC stream with columns `time`, `cell` (not for kind `state`) and `state`."""

import struct
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
    table = _load(content, {"time", "state"} if kind == "state" else {"time", "cell", "state"})
    times = _times(table.column("time"))
    cells = np.zeros(len(times), np.int64) if kind == "state" else _integers(table.column("cell"), "cell")
    states = _integers(table.column("state"), "state")
    cell_field = ("time[{}]" if kind == "state" else "cell[{}]").format
    return Columns(times, cells, narrow_states(states), "time[{}]".format, cell_field, "state[{}]".format, "time")


def _load(content: bytes, wanted: set[str]) -> Any:
    """The table; nothing but the schema is read before that is right, and nothing is ever unpacked."""
    try:
        with pa.ipc.open_stream(pa.py_buffer(content)) as reader:
            _check_columns(reader.schema, wanted)
            _refuse_packed(content)
            table = reader.read_all()
        table.validate(full=True)
    except (pa.ArrowException, OSError, ValueError, EOFError, MemoryError, struct.error) as error:
        raise UnreadableBodyError(f"The body is no Arrow IPC stream: {error}") from None
    _refuse_nulls(table)
    return table


def _refuse_packed(content: bytes) -> None:
    """Packed buffers would unpack to any size behind the limit of a body."""
    for message in pa.ipc.MessageReader.open_stream(pa.py_buffer(content)):
        if message.type == "record batch" and is_packed(message.metadata.to_pybytes()):
            raise UnreadableBodyError(
                "The buffers of this Arrow stream are compressed. Write it without compression; "
                "to save bandwidth send the whole body with Content-Encoding gzip or zstd."
            )


def is_packed(metadata: bytes) -> bool:
    """Whether the header of a record batch, a flatbuffer of Arrow's Message.fbs, names a compression."""
    (message,) = struct.unpack_from("<I", metadata)
    header = _field(metadata, message, 2)
    if header is None:
        return False
    return _field(metadata, header + struct.unpack_from("<I", metadata, header)[0], 3) is not None


def _field(metadata: bytes, table: int, number: int) -> int | None:
    """Where field `number` of a flatbuffer's table is, None where it is left out."""
    fields = table - struct.unpack_from("<i", metadata, table)[0]
    (size,) = struct.unpack_from("<H", metadata, fields)
    entry = 4 + 2 * number
    offset = struct.unpack_from("<H", metadata, fields + entry)[0] if entry < size else 0
    return table + offset if offset else None


def _check_columns(schema: Any, wanted: set[str]) -> None:
    names = list(schema.names)
    errors = [
        FieldError(name, f"this column is not known here; send {', '.join(sorted(wanted))}")
        for name in dict.fromkeys(names)
        if name not in wanted
    ]
    errors += [FieldError(name, "this column is missing") for name in sorted(wanted - set(names))]
    errors += [FieldError(name, "this column stands twice") for name in sorted(wanted) if names.count(name) > 1]
    errors += [
        FieldError(each.name, message) for each in schema if each.name in wanted and (message := _wrong_type(each))
    ]
    if errors:
        raise InvalidInputError(*errors)


def _wrong_type(column: Any) -> str | None:
    """What is wrong with the type of a column, None where nothing is."""
    kind = column.type
    if column.name != "time":
        right = pa.types.is_integer(kind) or (column.name == "state" and pa.types.is_boolean(kind))
        return None if right else f"its type is {kind}; send {'uint8 or bool' if column.name == 'state' else 'uint32'}"
    if pa.types.is_timestamp(kind):
        return None if kind.tz else "these timestamps have no zone; send timestamps with tz, or Unix seconds"
    right = pa.types.is_float64(kind) or pa.types.is_integer(kind)
    return None if right else f"its type is {kind}; send float64 Unix seconds or timestamps with a zone"


def _refuse_nulls(table: Any) -> None:
    nulls = [name for name in table.column_names if table.column(name).null_count]
    if nulls:
        raise InvalidInputError(*(FieldError(name, "it has nulls; send every value") for name in nulls))


def _times(column: Any) -> NDArray[np.float64]:
    if not pa.types.is_timestamp(column.type):
        return np.asarray(column.to_numpy(), np.float64)
    unit = {"s": 1, "ms": 1e3, "us": 1e6, "ns": 1e9}[column.type.unit]
    return np.asarray(column.cast(pa.int64()).to_numpy() / unit, np.float64)


def _integers(column: Any, field: str) -> NDArray[np.int64]:
    if pa.types.is_boolean(column.type):
        column = column.cast(pa.uint8())
    values = column.to_numpy()
    if values.dtype == np.uint64 and (values > np.iinfo(np.int64).max).any():
        raise InvalidInputError.at(field, "a value is too large")
    return np.asarray(values, np.int64)

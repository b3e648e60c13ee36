"""Arrow IPC streams: observations with the columns `time`, `cell` (not for kind `state`) and `state`, and answers."""

import json
import struct
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from tidemap.errors import FieldError, InvalidInputError, UnreadableBodyError
from tidemap.formats.table import Column, Labels, Nullable, wanted, without_nan
from tidemap.history.columns import Columns, Content, Integers, misnamed, of_table
from tidemap.space.grid import GridGeometry


def read(content: Content, grid: GridGeometry) -> Columns:
    """Columns of an Arrow IPC stream. Raises UnreadableBodyError, InvalidInputError."""
    table = _load(content, partial(_check_columns, columns=wanted(grid)), nullable={"state"})
    cell = None if grid.is_single else _integers(table.column("cell"))
    return of_table(_times(table.column("time")), cell, *_states(table.column("state")))


def read_floats(content: Content, needed: Sequence[str], more: Sequence[str] = ()) -> dict[str, NDArray[np.floating]]:
    """Columns of float32 or float64 (n,), those that are needed and those of `more` that are there.

    Raises UnreadableBodyError, InvalidInputError.
    """

    def check(schema: Any) -> None:
        known = [*needed, *more]
        errors = [FieldError(name, "this column is missing") for name in needed if name not in schema.names]
        for each in schema:
            if each.name not in known or schema.names.count(each.name) > 1:
                errors.append(FieldError(each.name, f"send {', '.join(known)} once each, and no other column"))
            elif not (pa.types.is_float32(each.type) or pa.types.is_float64(each.type)):
                errors.append(FieldError(each.name, f"its type is {each.type}; send float32 or float64"))
        if errors:
            raise InvalidInputError(*errors)

    table = _load(content, check)
    return {name: _array_values(table.column(name)) for name in table.column_names}


def _load(content: Content, check: Callable[[Any], None], nullable: Collection[str] = ()) -> Any:
    """The table; nothing but the schema is read before that is right, and nothing is ever unpacked."""
    try:
        with pa.ipc.open_stream(pa.py_buffer(content)) as reader:
            check(reader.schema)
            _refuse_packed(content)
            table = reader.read_all()
        table.validate(full=True)
    except (pa.ArrowException, OSError, ValueError, EOFError, MemoryError, struct.error) as error:
        raise UnreadableBodyError(f"The body is no Arrow IPC stream: {error}") from None
    _refuse_nulls(table, nullable)
    return table


def _refuse_packed(content: Content) -> None:
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


def _check_columns(schema: Any, columns: list[str]) -> None:
    errors = misnamed(list(schema.names), columns)
    unknown = {error.field for error in errors}
    errors += [
        FieldError(each.name, message) for each in schema if each.name not in unknown and (message := _wrong_type(each))
    ]
    if errors:
        raise InvalidInputError(*errors)


def _wrong_type(column: Any) -> str | None:
    """What is wrong with the type of a column, None where nothing is."""
    kind = column.type
    if column.name != "time":
        right = pa.types.is_integer(kind) or (column.name == "state" and _may_be_state(kind))
        kinds = "uint8 or bool, null where the sensor is unavailable" if column.name == "state" else "uint32"
        return None if right else f"its type is {kind}; send {kinds}"
    if pa.types.is_timestamp(kind):
        return None if kind.tz else "these timestamps have no zone; send timestamps with tz, or Unix seconds"
    right = pa.types.is_float64(kind) or pa.types.is_int64(kind) or pa.types.is_uint64(kind)
    return None if right else f"its type is {kind}; send float64 Unix seconds or timestamps with a zone"


def _may_be_state(kind: Any) -> bool:
    """Whether a type that is not whole numbers can say states: those with NaN in place of null are floats."""
    return bool(pa.types.is_boolean(kind) or pa.types.is_float32(kind) or pa.types.is_float64(kind))


def _refuse_nulls(table: Any, but: Collection[str]) -> None:
    nulls = [name for name in table.column_names if name not in but and table.column(name).null_count]
    if nulls:
        raise InvalidInputError(*(FieldError(name, "it has nulls; send every value") for name in nulls))


def _times(column: Any) -> NDArray[np.float64]:
    if not pa.types.is_timestamp(column.type):
        return np.asarray(_array_values(column), np.float64)
    unit = {"s": 1, "ms": 1e3, "us": 1e6, "ns": 1e9}[column.type.unit]
    return np.asarray(_array_values(column.cast(pa.int64())) / unit, np.float64)


def _states(column: Any) -> tuple[Integers, NDArray[np.bool_] | None]:
    """The states of a column, 0 where it is null or NaN, and where that is; None where it is nowhere."""
    if pa.types.is_floating(column.type):
        return without_nan(_array_values(column.fill_null(float("nan"))))
    if not column.null_count:
        return _integers(column), None
    filled = column.fill_null(False if pa.types.is_boolean(column.type) else 0)
    return _integers(filled), _array_values(column.is_null())


def _integers(column: Any) -> Integers:
    return _array_values(column.cast(pa.uint8()) if pa.types.is_boolean(column.type) else column)


def _array_values(column: Any) -> NDArray[Any]:
    """The values of a column; those of a single batch where they stand in the body."""
    array = column.chunk(0) if column.num_chunks == 1 else column.combine_chunks()
    return np.asarray(array.to_numpy(zero_copy_only=False))


def write(facts: Mapping[str, Any], columns: Mapping[str, Column]) -> memoryview:
    """An IPC stream of equally long columns; `facts` go into the schema as JSON under `tidemap`."""
    table = pa.table({name: _arrow(column) for name, column in columns.items()}).replace_schema_metadata(_facts(facts))
    # One block of the right size: a sink that grows would copy what it has again and again.
    content = pa.allocate_buffer(_size(table))
    _write(pa.FixedSizeBufferWriter(content), table)
    return memoryview(content)


def _arrow(column: Column) -> Any:
    if isinstance(column, Labels):
        return pa.DictionaryArray.from_arrays(pa.array(column.codes.astype(np.int8)), pa.array(column.names))
    return pa.array(column.values, mask=column.missing) if isinstance(column, Nullable) else pa.array(column)


def _facts(metadata: Mapping[str, Any]) -> dict[bytes, bytes]:
    return {b"tidemap": json.dumps(dict(metadata)).encode()}


def _size(content: Any) -> int:
    size = pa.MockOutputStream()
    _write(size, content)
    return int(size.size())


def _write(sink: Any, content: Any) -> None:
    """A table or a record batch."""
    with pa.ipc.new_stream(sink, content.schema) as writer:
        writer.write(content)


@dataclass(frozen=True, slots=True, eq=False)
class ArrowBuffer:
    """An IPC stream of one batch, in one piece of memory, whose columns can be written anew where they lie.

    Its schema is not part of `content` (n_bytes,) uint8: that carries facts, and is made for every answer.
    columns (n,): views of `content`; of labels the codes.
    """

    schema: Any
    content: NDArray[np.uint8]
    columns: Mapping[str, NDArray[Any]]

    @classmethod
    def of(cls, columns: Mapping[str, Column]) -> "ArrowBuffer":
        """A buffer with these equally long columns."""
        batch = pa.record_batch({name: _arrow(column) for name, column in columns.items()})
        whole = np.empty(_size(batch), np.uint8)
        _write(pa.FixedSizeBufferWriter(pa.py_buffer(whole)), batch)
        with pa.ipc.open_stream(pa.py_buffer(whole)) as reader:
            read = reader.read_next_batch()
        found = {name: _values(whole, read[name]) for name in read.schema.names}
        return cls(batch.schema, whole[batch.schema.serialize().size :], found)

    def head(self, metadata: Mapping[str, Any]) -> bytes:
        """What comes before `content`; as `write` writes it."""
        return bytes(self.schema.with_metadata(_facts(metadata)).serialize())


def _values(whole: NDArray[np.uint8], column: Any) -> NDArray[Any]:
    """The values of a column that was read from `whole`, as a view of it."""
    numbers = column.indices if pa.types.is_dictionary(column.type) else column
    kind = np.dtype(numbers.type.to_pandas_dtype())
    if not len(numbers):
        return np.empty(0, kind)
    first = numbers.buffers()[1].address - whole.ctypes.data
    return whole[first : first + len(numbers) * kind.itemsize].view(kind)

"""Arrow IPC streams of answers."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

ARROW = "application/vnd.apache.arrow.stream"


def encode_table(columns: Mapping[str, Any], metadata: Mapping[str, Any]) -> memoryview:
    """An IPC stream of equally long columns; `metadata` goes into the schema as JSON under `tidemap`."""
    table = pa.table(dict(columns)).replace_schema_metadata(_facts(metadata))
    # One block of the right size: a sink that grows would copy what it has again and again.
    content = pa.allocate_buffer(_size(table))
    _write(pa.FixedSizeBufferWriter(content), table)
    return memoryview(content)


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


def nullable(values: NDArray[np.generic], missing: NDArray[np.bool_]) -> Any:
    """An Arrow array with nulls where `missing`."""
    return pa.array(values, mask=missing)


def labels(codes: NDArray[np.uint8], names: tuple[str, ...]) -> Any:
    """A dictionary-encoded column of names by code."""
    return pa.DictionaryArray.from_arrays(pa.array(codes.astype(np.int8)), pa.array(names))


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
    def of(cls, columns: Mapping[str, Any]) -> "ArrowBuffer":
        """A sheet with these equally long columns."""
        batch = pa.record_batch(dict(columns))
        whole = np.empty(_size(batch), np.uint8)
        _write(pa.FixedSizeBufferWriter(pa.py_buffer(whole)), batch)
        with pa.ipc.open_stream(pa.py_buffer(whole)) as reader:
            read = reader.read_next_batch()
        found = {name: _values(whole, read[name]) for name in read.schema.names}
        return cls(batch.schema, whole[batch.schema.serialize().size :], found)

    def head(self, metadata: Mapping[str, Any]) -> bytes:
        """What comes before `content`; as `encode_table` writes it."""
        return bytes(self.schema.with_metadata(_facts(metadata)).serialize())


def _values(whole: NDArray[np.uint8], column: Any) -> NDArray[Any]:
    """The values of a column that was read from `whole`, as a view of it."""
    numbers = column.indices if pa.types.is_dictionary(column.type) else column
    kind = np.dtype(numbers.type.to_pandas_dtype())
    if not len(numbers):
        return np.empty(0, kind)
    first = numbers.buffers()[1].address - whole.ctypes.data
    return whole[first : first + len(numbers) * kind.itemsize].view(kind)

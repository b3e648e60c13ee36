"""Arrow IPC streams, where pyarrow is installed (the extra `arrow`)."""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

try:
    import pyarrow
except ImportError:
    pyarrow = None

pa: Any = pyarrow
"""None where pyarrow is not installed; the functions here need it."""


def write(columns: Mapping[str, NDArray[Any]]) -> bytes:
    """A stream of equally long columns."""
    batch = pa.RecordBatch.from_pydict({name: pa.array(column) for name, column in columns.items()})
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, batch.schema) as stream:
        stream.write_batch(batch)
    return bytes(sink.getvalue())


def read(content: bytes) -> tuple[Any, dict[str, NDArray[Any]]]:
    """What the schema carries as JSON under `tidemap`, and the columns: NaN for null, labels as texts."""
    with pa.ipc.open_stream(pa.py_buffer(content)) as stream:
        table = stream.read_all()
    return json.loads(table.schema.metadata[b"tidemap"]), {
        name: _values(table.column(name)) for name in table.column_names
    }


def read_columns(content: bytes) -> dict[str, NDArray[Any]]:
    """The columns of a stream that `write` wrote."""
    with pa.ipc.open_stream(pa.py_buffer(content)) as stream:
        table = stream.read_all()
    return {name: np.asarray(table.column(name).to_numpy()) for name in table.column_names}


def _values(column: Any) -> NDArray[Any]:
    if pa.types.is_string(column.type):
        return np.array(column.to_pylist(), np.str_)
    if not pa.types.is_dictionary(column.type):
        return np.asarray(column.to_numpy())
    labels = column.combine_chunks()
    words = np.array(labels.dictionary.to_pylist() or [""], np.str_)
    chosen: NDArray[Any] = words[labels.indices.to_numpy(zero_copy_only=False)]
    return chosen

"""Arrow IPC streams of answers."""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

ARROW = "application/vnd.apache.arrow.stream"


def encode_table(columns: Mapping[str, Any], metadata: Mapping[str, Any]) -> memoryview:
    """An IPC stream of equally long columns; `metadata` goes into the schema as JSON under `tidemap`."""
    table = pa.table(dict(columns)).replace_schema_metadata({b"tidemap": json.dumps(dict(metadata)).encode()})
    size = pa.MockOutputStream()
    _write(size, table)
    # One block of the right size: a sink that grows would copy what it has again and again.
    content = pa.allocate_buffer(size.size())
    _write(pa.FixedSizeBufferWriter(content), table)
    return memoryview(content)


def _write(sink: Any, table: Any) -> None:
    with pa.ipc.new_stream(sink, table.schema) as writer:
        writer.write_table(table)


def nullable(values: NDArray[np.generic], missing: NDArray[np.bool_]) -> Any:
    """An Arrow array with nulls where `missing`."""
    return pa.array(values, mask=missing)


def labels(codes: NDArray[np.uint8], names: tuple[str, ...]) -> Any:
    """A dictionary-encoded column of names by code."""
    return pa.DictionaryArray.from_arrays(pa.array(codes.astype(np.int8)), pa.array(names))

"""Arrow IPC streams of answers."""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

ARROW = "application/vnd.apache.arrow.stream"


def encode_table(columns: Mapping[str, Any], metadata: Mapping[str, Any]) -> bytes:
    """An IPC stream of equally long columns; `metadata` goes into the schema as JSON under `tidemap`."""
    table = pa.table(dict(columns)).replace_schema_metadata({b"tidemap": json.dumps(dict(metadata)).encode()})
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema) as writer:
        writer.write_table(table)
    return bytes(sink.getvalue())


def nullable(values: NDArray[np.generic], missing: NDArray[np.bool_]) -> Any:
    """An Arrow array with nulls where `missing`."""
    return pa.array(values, mask=missing)


def labels(codes: NDArray[np.uint8], names: tuple[str, ...]) -> Any:
    """A dictionary-encoded column of names by code."""
    return pa.DictionaryArray.from_arrays(pa.array(codes.astype(np.int8)), pa.array(names))

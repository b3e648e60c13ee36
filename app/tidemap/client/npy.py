"""npy files."""

import io
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray


def write_rows(columns: Mapping[str, NDArray[Any]]) -> bytes:
    """A file with one row a measurement, its fields the equally long columns."""
    length = len(next(iter(columns.values())))
    table = np.empty(length, [(name, column.dtype) for name, column in columns.items()])
    for name, column in columns.items():
        table[name] = column
    return write(table)


def read(content: bytes) -> NDArray[Any]:
    """The array of a file."""
    array: NDArray[Any] = np.load(io.BytesIO(content), allow_pickle=False)
    return array


def write(array: NDArray[Any]) -> bytes:
    """A file of an array."""
    sink = io.BytesIO()
    np.save(sink, array)
    return sink.getvalue()

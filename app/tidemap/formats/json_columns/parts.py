"""JSON of large arrays in parts: each is made in a few milliseconds, so that other threads take turns."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import orjson

from tidemap.formats.table import Column, Labels, Nullable

PART_VALUES = 1 << 14


def to_json(value: Any) -> bytes:
    """JSON of nested values and arrays; NaN becomes null."""
    return orjson.dumps(value, option=orjson.OPT_SERIALIZE_NUMPY)


def write(content: Mapping[str, Any]) -> list[bytes]:
    """The JSON object of plain values and columns (of one or two axes), in parts.

    >>> b"".join(write({"a": 1, "b": np.array([[0.5, np.nan]]), "c": Labels(np.array([1]), ("no", "yes"))}))
    b'{"a":1,"b":[[0.5,null]],"c":["yes"]}'
    """
    parts = []
    for i, (name, value) in enumerate(content.items()):
        parts.append((b"," if i else b"{") + to_json(name) + b":")
        parts.extend(_column(value) if isinstance(value, np.ndarray | Labels | Nullable) else [to_json(value)])
    return [*parts, b"}"]


def _column(column: Column) -> Iterator[bytes]:
    shape = _shape(column)
    if int(np.prod(shape)) <= PART_VALUES:
        yield to_json(_values(column))
    elif len(shape) > 1 and shape[1] > PART_VALUES:
        for i in range(shape[0]):
            yield b"," if i else b"["
            yield from _column(_select(column, i))
        yield b"]"
    else:
        step = PART_VALUES if len(shape) == 1 else max(1, PART_VALUES // max(1, shape[1]))
        for start in range(0, shape[0], step):
            yield b"," if start else b"["
            yield to_json(_values(_select(column, slice(start, start + step))))[1:-1]
        yield b"]"


def _shape(column: Column) -> tuple[int, ...]:
    if isinstance(column, Labels):
        return column.codes.shape
    return column.values.shape if isinstance(column, Nullable) else column.shape


def _select(column: Column, rows: int | slice) -> Column:
    if isinstance(column, Labels):
        return Labels(column.codes[rows], column.names)
    if isinstance(column, Nullable):
        return Nullable(column.values[rows], column.missing[rows])
    return column[rows]


def _values(column: Column) -> Any:
    """What the encoder takes; it writes NaN as null."""
    if isinstance(column, Labels):
        return np.array(column.names, object)[column.codes].tolist()
    if not isinstance(column, Nullable):
        return np.ascontiguousarray(column)
    if column.values.dtype.kind == "f":
        return np.where(column.missing, np.nan, column.values)
    values = column.values.astype(object)
    values[column.missing] = None
    return values.tolist()

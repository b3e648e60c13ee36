"""JSON of large arrays in parts: each is made in a few milliseconds, so that other threads take turns."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import orjson
from numpy.typing import NDArray

PART_VALUES = 1 << 14


def to_json(value: Any) -> bytes:
    """JSON of nested values and arrays; NaN becomes null."""
    return orjson.dumps(value, option=orjson.OPT_SERIALIZE_NUMPY)


@dataclass(frozen=True, slots=True, eq=False)
class Mapped:
    """An array of one or two axes whose values are written as `encode` gives them, part by part."""

    values: NDArray[Any]
    encode: Callable[[NDArray[Any]], Any]


def json_parts(content: Mapping[str, Any]) -> list[bytes]:
    """The JSON object of plain values and arrays (of one or two axes, or `Mapped`), in parts.

    >>> b"".join(json_parts({"a": 1, "b": np.array([[0.5, np.nan]])}))
    b'{"a":1,"b":[[0.5,null]]}'
    """
    parts = []
    for i, (name, value) in enumerate(content.items()):
        parts.append((b"," if i else b"{") + to_json(name) + b":")
        parts.extend(_value(value))
    return [*parts, b"}"]


def _value(value: Any) -> Iterator[bytes]:
    if isinstance(value, Mapped):
        yield from _array(value.values, value.encode)
    elif isinstance(value, np.ndarray):
        yield from _array(value, np.ascontiguousarray)
    else:
        yield to_json(value)


def _array(values: NDArray[Any], encode: Callable[[NDArray[Any]], Any]) -> Iterator[bytes]:
    if values.size <= PART_VALUES:
        yield to_json(encode(values))
    elif values.ndim > 1 and values.shape[1] > PART_VALUES:
        for i, row in enumerate(values):
            yield b"," if i else b"["
            yield from _array(row, encode)
        yield b"]"
    else:
        step = PART_VALUES if values.ndim == 1 else max(1, PART_VALUES // max(1, values.shape[1]))
        for start in range(0, len(values), step):
            yield b"," if start else b"["
            yield to_json(encode(values[start : start + step]))[1:-1]
        yield b"]"

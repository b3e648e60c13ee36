"""npy observations: a structured array with the fields `time`, `cell` (not for kind `state`) and `state`."""

import io
from typing import Any

import numpy as np
from numpy.lib import format as npy

from app.errors import FieldError, InvalidInputError, UnreadableBodyError
from app.ingest.columns import Columns, Content, Integers, misnamed, of_table, wanted
from app.space.grid import Grid

MOST_HEAD = 4096
"""Bytes of the longest header that is read; that of three fields has 128."""
HEADS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
"""By the version of the file. numpy writes others only for names of fields that are no Latin-1."""


def read(content: Content, kind: str, grid: Grid) -> Columns:
    """Columns of an npy file. Raises UnreadableBodyError, InvalidInputError."""
    del grid
    rows = _load(content, kind)
    time = np.ascontiguousarray(rows["time"], np.float64)
    return of_table(time, None if kind == "state" else _integers(rows["cell"]), _integers(rows["state"]))


def _load(content: Content, kind: str) -> Any:
    """The rows where they stand in the body."""
    stream = io.BytesIO(content[:MOST_HEAD])
    try:
        shape, _, dtype = HEADS[npy.read_magic(stream)](stream, max_header_size=MOST_HEAD)
    except Exception as error:  # a header is a text in Python's syntax: its reader stumbles in many ways
        raise UnreadableBodyError(f"The body is no npy file; write it with numpy.save: {error}") from None
    _check_type(dtype, kind)
    if len(shape) != 1:
        raise InvalidInputError.at("body", f"its shape is {shape}; send one row a measurement: shape (n,)")
    start = stream.tell()
    if shape[0] * dtype.itemsize != len(content) - start:
        raise UnreadableBodyError(
            f"The npy file declares {shape[0]} rows of {dtype.itemsize} bytes, but {len(content) - start} bytes "
            "follow its header. Send the whole file and nothing else."
        )
    return np.ndarray(shape, dtype, content, start)


def _check_type(dtype: np.dtype[Any], kind: str) -> None:
    """Raises InvalidInputError naming every field that is wrong."""
    if dtype.names is None:
        fields = ", ".join(wanted(kind))
        raise InvalidInputError.at("body", f"its type is {dtype}; send a structured array with the fields {fields}")
    errors = misnamed(list(dtype.names), kind)
    unknown = {error.field for error in errors}
    errors += [
        FieldError(name, message)
        for name in dtype.names
        if name not in unknown and (message := _wrong_type(name, dtype[name]))
    ]
    if errors:
        raise InvalidInputError(*errors)


def _wrong_type(name: str, dtype: np.dtype[Any]) -> str | None:
    """What is wrong with the type of a field, None where nothing is."""
    if name == "time":
        right = dtype.kind in "iuf" and dtype.itemsize == 8
        return None if right else f"its type is {dtype}; send float64 Unix seconds"
    right = dtype.kind in "iu" or (name == "state" and dtype.kind == "b")
    return None if right else f"its type is {dtype}; send {'uint8 or bool' if name == 'state' else 'uint32'}"


def _integers(values: Any) -> Integers:
    if values.dtype.kind == "b":
        values = values.view(np.uint8)  # a file's byte may be neither 0 nor 1
    return np.ascontiguousarray(values, values.dtype.newbyteorder("="))

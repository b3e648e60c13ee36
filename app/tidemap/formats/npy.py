"""npy: observations as rows or as a grid at one time, and grids of probabilities."""

import io
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from tidemap.errors import FieldError, InvalidInputError, UnreadableBodyError
from tidemap.formats.table import wanted
from tidemap.history.columns import Columns, Content, Integers, misnamed, of_table
from tidemap.space.grid import GridGeometry

UNSEEN = 255
"""In a grid: a cell that was not seen; -1 where the bytes are signed."""
MAX_HEAD_BYTES = 4096
"""Bytes of the longest header that is read; that of three fields has 128."""
HEADS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
"""By the version of the file. numpy writes others only for names of fields that are no Latin-1."""


def read(content: Content, grid: GridGeometry) -> Columns:
    """Columns of an npy file. Raises UnreadableBodyError, InvalidInputError."""
    rows = _load(content, wanted(grid))
    time = np.ascontiguousarray(rows["time"], np.float64)
    return of_table(time, None if grid.is_single else _integers(rows["cell"]), _integers(rows["state"]))


def read_grid(content: Content, grid: GridGeometry, time: float) -> Columns:
    """Columns of an npy file that has the state of every cell at one time; what was not seen is left out.

    Raises UnreadableBodyError, InvalidInputError.
    """
    states = _load_grid(content, grid)
    cell = np.flatnonzero(states != UNSEEN).astype(np.uint32)

    def cell_field(row: int) -> str:
        return f"body[{cell[row]}]"

    return Columns(np.full(len(cell), time), cell, states[cell], lambda _: "time", cell_field, cell_field, "body")


def _load_grid(content: Content, grid: GridGeometry) -> NDArray[np.uint8]:
    """The state of each cell (n_cells,), of bytes that need not be signed alike."""
    head = _head(content)
    if head.dtype.names is not None:
        raise InvalidInputError.at("time", "the rows of a structured array have times of their own; leave `time` out")
    if head.dtype.itemsize != 1 or head.dtype.kind not in "iub":
        raise InvalidInputError.at("body", f"its type is {head.dtype}; send a grid of uint8, int8 or bool")
    if head.shape not in (grid.shape, (grid.n_cells,)):
        raise InvalidInputError.at("body", f"its shape is {head.shape}; send {grid.shape} or {(grid.n_cells,)}")
    _check_length(head, content)
    array = np.ndarray(head.shape, np.uint8, content, head.end, order="F" if head.fortran else "C")
    return array.reshape(-1)


def _load(content: Content, fields: list[str]) -> Any:
    """The rows where they stand in the body."""
    head = _head(content)
    _check_type(head.dtype, fields)
    if len(head.shape) != 1:
        raise InvalidInputError.at("body", f"its shape is {head.shape}; send one row a measurement: shape (n,)")
    _check_length(head, content)
    return np.ndarray(head.shape, head.dtype, content, head.end)


@dataclass(frozen=True, slots=True)
class Head:
    """What the header of an npy file says, and where it ends."""

    shape: tuple[int, ...]
    fortran: bool
    dtype: np.dtype[Any]
    end: int


def _head(content: Content) -> Head:
    """What the file begins with. Raises UnreadableBodyError."""
    stream = io.BytesIO(content[:MAX_HEAD_BYTES])
    try:
        shape, fortran, dtype = HEADS[npy.read_magic(stream)](stream, max_header_size=MAX_HEAD_BYTES)
    except Exception as error:  # a header is a text in Python's syntax: its reader stumbles in many ways
        raise UnreadableBodyError(f"The body is no npy file; write it with numpy.save: {error}") from None
    return Head(shape, fortran, dtype, stream.tell())


def _check_length(head: Head, content: Content) -> None:
    """Raises UnreadableBodyError for a file that is not as long as its header says."""
    if math.prod(head.shape) * head.dtype.itemsize != len(content) - head.end:
        raise UnreadableBodyError(
            f"The npy file declares {math.prod(head.shape)} items of {head.dtype.itemsize} bytes, but "
            f"{len(content) - head.end} bytes follow its header. Send the whole file and nothing else."
        )


def _check_type(dtype: np.dtype[Any], fields: list[str]) -> None:
    """Raises InvalidInputError naming every field that is wrong."""
    if dtype.names is None:
        raise InvalidInputError.at(
            "body",
            f"its type is {dtype}; send a structured array with the fields {', '.join(fields)}, "
            "or a grid of uint8 and its time as ?time=",
        )
    errors = misnamed(list(dtype.names), fields)
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


def write_grid(grid: NDArray[np.float32]) -> list[bytes | memoryview]:
    """An npy file of a grid in C order, in parts: its header, and its values as they lie."""
    head = io.BytesIO()
    npy.write_array_header_1_0(head, npy.header_data_from_array_1_0(grid))
    return [head.getvalue(), grid.reshape(-1).view(np.uint8).data]

"""npy: observations as rows or as a grid at one time, and grids of probabilities."""

import io
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from tidemap.errors import FieldError, InvalidInputError, UnreadableBodyError
from tidemap.formats.table import wanted, without_nan
from tidemap.history.columns import Columns, Content, Integers, misnamed, of_table
from tidemap.space.grid import GridGeometry

UNSEEN = 255
"""In a grid: a cell that was not seen; -1 where the bytes are signed."""
FREE_PERCENT, OCCUPIED_PERCENT, MAX_PERCENT = 25, 65, 100
"""In layout `ros`: up to where a cell is free, from where on it is occupied, and the highest there is."""
MAX_HEAD_BYTES = 4096
"""Bytes of the longest header that is read; that of three fields has 128."""
MAX_DIMENSIONS = 32
"""Of an array: what every release of numpy can hold."""
HEADS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
"""By the version of the file. numpy writes others only for names of fields that are no Latin-1."""


def read(content: Content, grid: GridGeometry) -> Columns:
    """Columns of an npy file. Raises UnreadableBodyError, InvalidInputError."""
    rows = _load(content, wanted(grid))
    time = np.ascontiguousarray(rows["time"], np.float64)
    cell = None if grid.is_single else _integers(rows["cell"])
    if rows["state"].dtype.kind == "f":
        return of_table(time, cell, *without_nan(rows["state"]))
    return of_table(time, cell, _integers(rows["state"]))


def read_grid(content: Content, grid: GridGeometry, time: float) -> Columns:
    """Columns of an npy file that has the state of every cell at one time; what was not seen is left out.

    Raises UnreadableBodyError, InvalidInputError.
    """
    return _seen(_load_grid(content, grid, grid.shape), time)


def read_occupancy(content: Content, grid: GridGeometry, time: float) -> Columns:
    """As `read_grid`, of a file in the layout of nav_msgs/OccupancyGrid: (ny, nx) with y upwards, in percent or -1.

    65 and more is occupied, 25 and less free, as map_server has it; what is between was not seen.
    Raises UnreadableBodyError, InvalidInputError.
    """
    nx, ny, nz = grid.shape3
    if nz != 1:
        raise InvalidInputError.at("layout", f"the location has {nz} layers, but a map in layout 'ros' has one")
    percent = _load_grid(content, grid, (ny, nx)).reshape(ny, nx).T.reshape(-1)
    if ((percent > MAX_PERCENT) & (percent != UNSEEN)).any():
        raise InvalidInputError.at("body", "in layout 'ros' a cell is 0 to 100 percent, or -1 where it was not seen")
    states = np.full(grid.n_cells, UNSEEN, np.uint8)
    states[percent <= FREE_PERCENT] = 0
    states[(percent >= OCCUPIED_PERCENT) & (percent != UNSEEN)] = 1
    return _seen(states, time)


def _seen(states: NDArray[np.uint8], time: float) -> Columns:
    """The columns of all cells (n_cells,) at one time; what was not seen is left out."""
    cell = np.flatnonzero(states != UNSEEN).astype(np.uint32)

    def cell_field(row: int) -> str:
        return f"body[{cell[row]}]"

    return Columns(np.full(len(cell), time), cell, states[cell], lambda _: "time", cell_field, cell_field, "body")


def read_array(content: Content) -> NDArray[Any]:
    """An array of plain numbers, as a view of the content. Raises UnreadableBodyError, InvalidInputError."""
    head = _head(content)
    if head.dtype.kind not in "iubf" or not head.shape:
        raise InvalidInputError.at(
            "body", f"its type is {head.dtype}, its shape {head.shape}; send an array of numbers"
        )
    _check_length(head, content)
    return np.ndarray(head.shape, head.dtype, content, head.end, order="F" if head.fortran else "C")


def _load_grid(content: Content, grid: GridGeometry, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """The bytes of each cell (n_cells,), signed or not, of an array of this shape or flat."""
    head = _head(content)
    if head.dtype.names is not None:
        raise InvalidInputError.at("time", "the rows of a structured array have times of their own; leave `time` out")
    if head.dtype.itemsize != 1 or head.dtype.kind not in "iub":
        raise InvalidInputError.at("body", f"its type is {head.dtype}; send a grid of uint8, int8 or bool")
    if head.shape not in (shape, (grid.n_cells,)):
        raise InvalidInputError.at("body", f"its shape is {head.shape}; send {shape} or {(grid.n_cells,)}")
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
    if len(shape) > MAX_DIMENSIONS or not all(0 <= n <= len(content) for n in shape):
        raise UnreadableBodyError(
            f"The npy file declares the shape {str(shape)[:80]}, which its {len(content)} bytes cannot have. "
            "Write it with numpy.save, and send the whole file."
        )
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
    right = dtype.kind in "iu" or (name == "state" and dtype.kind in "bf")
    kinds = "uint8 or bool, or floats with NaN where the sensor is unavailable" if name == "state" else "uint32"
    return None if right else f"its type is {dtype}; send {kinds}"


def _integers(values: Any) -> Integers:
    if values.dtype.kind == "b":
        values = values.view(np.uint8)  # a file's byte may be neither 0 nor 1
    return np.ascontiguousarray(values, values.dtype.newbyteorder("="))


def write_grid(grid: NDArray[np.float32]) -> list[bytes | memoryview]:
    """An npy file of a grid in C order, in parts: its header, and its values as they lie."""
    head = io.BytesIO()
    npy.write_array_header_1_0(head, npy.header_data_from_array_1_0(grid))
    return [head.getvalue(), grid.reshape(-1).view(np.uint8).data]

"""Reading posted observations: JSON, Arrow and npy bodies to measurements, columnar, refusing what is wrong by name."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from app.errors import InvalidInputError, UnsupportedMediaTypeError
from app.ingest import arrow_body, json_body, npy_body
from app.ingest.columns import Columns, Content
from app.schemas.common import FARTHEST_S
from app.space.grid import Grid
from app.spectral.measurements import Measurements

ARROW = "application/vnd.apache.arrow.stream"
JSON = "application/json"
NPY = "application/x-npy"
COST = {JSON: 40, ARROW: 12, NPY: 12}
"""Bytes of memory that each byte of a body takes at most until its measurements are stored; its own included."""
BLOCK = 1 << 18
"""Rows that are checked at once."""


@dataclass(frozen=True)
class Body:
    """The unpacked bytes of a post and their media type."""

    content: Content
    media_type: str

    @cached_property
    def digest(self) -> bytes:
        """What tells two bodies apart."""
        digest = hashlib.sha256(self.media_type.encode() + b"\0")
        digest.update(self.content)
        return digest.digest()


@dataclass(frozen=True, slots=True)
class Target:
    """What the measurements are for: the location's kind and grid, and the latest time they may have."""

    kind: str
    grid: Grid
    latest: float


READERS: dict[str, Callable[[Content, str, Grid], Columns]] = {
    JSON: json_body.read,
    ARROW: arrow_body.read,
    NPY: npy_body.read,
}


def parse(body: Body, target: Target) -> Measurements:
    """The measurements of a body; their arrays may be views of it.

    Raises UnsupportedMediaTypeError, UnreadableBodyError, InvalidInputError naming the first offending place.
    """
    reader = READERS.get(body.media_type)
    if reader is None:
        raise UnsupportedMediaTypeError(
            f"Content-Type {body.media_type!r} is not read here; send one of {', '.join(READERS)}."
        )
    columns = reader(body.content, target.kind, target.grid)
    if not len(columns.time):
        raise InvalidInputError.at(columns.whole, "there is no measurement in it; send at least one")
    for start in range(0, len(columns.time), BLOCK):
        _check(columns, start, target)
    measurements = Measurements(
        columns.time, columns.cell.astype(np.uint32, copy=False), columns.state.astype(np.uint8, copy=False)
    )
    _refuse_contradictions(columns, measurements, target.grid.n_cells)
    return measurements


def _check(columns: Columns, start: int, target: Target) -> None:
    """Refuse what no measurement may be, in the block of rows from `start`."""
    rows = slice(start, start + BLOCK)
    time, cell, state = columns.time[rows], columns.cell[rows], columns.state[rows]
    refuse = partial(_refuse, start)
    refuse(~np.isfinite(time), columns.time_field, "NaN and infinity are no times; give Unix seconds")
    refuse(
        time > target.latest,
        columns.time_field,
        "this lies too far in the future; check the robot's clock and that times are in seconds",
    )
    refuse(time < -FARTHEST_S, columns.time_field, "this is no Unix time in seconds")
    refuse((state < 0) | (state > 1), columns.state_field, "a state is 0 (free) or 1 (occupied)")
    n_cells = target.grid.n_cells
    refuse((cell < 0) | (cell >= n_cells), columns.cell_field, f"cells are 0 to {n_cells - 1} here")


def _refuse(start: int, wrong: NDArray[np.bool_], field: Callable[[int], str], message: str) -> None:
    if wrong.any():
        raise InvalidInputError.at(field(start + int(np.argmax(wrong))), message)


def _refuse_contradictions(columns: Columns, measurements: Measurements, n_cells: int) -> None:
    """A cell is not both occupied and free at one time."""
    if (measurements.time[1:] > measurements.time[:-1]).all():
        return
    seen = _seen(measurements, n_cells)
    seen.sort()
    clash = (seen[1:] - seen[:-1] == 1) & (seen[1:] & 1 == 1)
    if clash.any():
        rows = np.flatnonzero(_seen(measurements, n_cells) >> 1 == seen[int(np.argmax(clash))] >> 1)
        state = measurements.state[rows]
        row = int(rows[np.argmax(state != state[0])])
        raise InvalidInputError.at(columns.cell_field(row), "this cell is both occupied and free at the same time")


def _seen(measurements: Measurements, n_cells: int) -> NDArray[np.int64]:
    """Of each measurement one number: twice that of its time and cell, and its state."""
    time = measurements.time
    if (time[1:] >= time[:-1]).all():
        seen = np.zeros(len(time), np.int64)
        np.cumsum(time[1:] != time[:-1], out=seen[1:])
    else:
        seen = np.unique(time, return_inverse=True)[1].astype(np.int64, copy=False)
    seen *= n_cells
    seen += measurements.cell
    seen *= 2
    seen += measurements.state
    return seen

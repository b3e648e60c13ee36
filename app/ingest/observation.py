"""Reading posted observations: JSON and Arrow bodies to measurements, columnar, refusing what is wrong by name."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from app.errors import InvalidInputError, UnsupportedMediaTypeError
from app.ingest import arrow_body, json_body
from app.ingest.columns import Columns
from app.schemas.common import FARTHEST_S
from app.space.grid import Grid
from app.spectral.measurements import Measurements

ARROW = "application/vnd.apache.arrow.stream"
JSON = "application/json"


@dataclass(frozen=True)
class Body:
    """The unpacked bytes of a post and their media type."""

    content: bytes
    media_type: str

    @cached_property
    def digest(self) -> bytes:
        """What tells two bodies apart."""
        return hashlib.sha256(self.media_type.encode() + b"\0" + self.content).digest()


@dataclass(frozen=True, slots=True)
class Target:
    """What the measurements are for: the location's kind and grid, and the latest time they may have."""

    kind: str
    grid: Grid
    latest: float


READERS: dict[str, Callable[[bytes, str, Grid], Columns]] = {
    JSON: json_body.read,
    ARROW: arrow_body.read,
}


def parse(body: Body, target: Target) -> Measurements:
    """The measurements of a body, in order (`Measurements.in_order`).

    Raises UnsupportedMediaTypeError, UnreadableBodyError, InvalidInputError naming the first offending place.
    """
    reader = READERS.get(body.media_type)
    if reader is None:
        raise UnsupportedMediaTypeError(
            f"Content-Type {body.media_type!r} is not read here; send one of {', '.join(READERS)}."
        )
    columns = reader(body.content, target.kind, target.grid)
    _refuse(
        columns,
        ~np.isfinite(columns.time),
        columns.time_field,
        "NaN and infinity are no times; give Unix seconds",
    )
    _refuse(
        columns,
        columns.time > target.latest,
        columns.time_field,
        "this lies too far in the future; check the robot's clock and that times are in seconds",
    )
    _refuse(columns, columns.time < -FARTHEST_S, columns.time_field, "this is no Unix time in seconds")
    _refuse(columns, columns.state > 1, columns.state_field, "a state is 0 (free) or 1 (occupied)")
    outside = (columns.cell < 0) | (columns.cell >= target.grid.n_cells)
    _refuse(columns, outside, columns.cell_field, f"cells are 0 to {target.grid.n_cells - 1} here")
    if not len(columns.time):
        raise InvalidInputError.at(columns.whole, "there is no measurement in it; send at least one")
    measurements = Measurements(columns.time, columns.cell.astype(np.uint32), columns.state).in_order()
    if _contradict(measurements).any():
        raise InvalidInputError.at(_contradiction(columns), "this cell is both occupied and free at the same time")
    return measurements


def _refuse(columns: Columns, wrong: NDArray[np.bool_], field: Callable[[int], str], message: str) -> None:
    if wrong.any():
        row = int(np.argmax(wrong))
        raise InvalidInputError.at(field(row), message)


def _contradict(measurements: Measurements) -> NDArray[np.bool_]:
    """(n - 1,) which of them, in order, say the opposite of the one before at the same time of the same cell."""
    time, cell, state = measurements.time, measurements.cell, measurements.state
    return np.asarray((state[1:] != state[:-1]) & (cell[1:] == cell[:-1]) & (time[1:] == time[:-1]))


def _contradiction(columns: Columns) -> str:
    """The place of the first measurement, as they were sent, that contradicts an earlier one."""
    order = np.lexsort((columns.cell, columns.time))
    clash = _contradict(Measurements(columns.time[order], columns.cell[order].astype(np.uint32), columns.state[order]))
    return columns.cell_field(int(order[int(np.argmax(clash)) + 1]))

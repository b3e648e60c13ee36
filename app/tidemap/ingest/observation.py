"""Reading posted observations: JSON, Arrow and npy bodies to measurements, columnar, refusing what is wrong by name."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
import xxhash
from numpy.typing import NDArray

from tidemap.errors import InvalidInputError, UnsupportedMediaTypeError
from tidemap.history.measurements import Measurements
from tidemap.history.snapshot import sort_snapshot
from tidemap.ingest import arrow_body, json_body, large_json, npy_body
from tidemap.ingest.columns import Columns, Content
from tidemap.schemas.common import FARTHEST_S
from tidemap.space.grid import GridGeometry

ARROW = "application/vnd.apache.arrow.stream"
JSON = "application/json"
NPY = "application/x-npy"
COST = {JSON: 24, ARROW: 12, NPY: 12}
"""`Body.cost` of a body, by its media type …"""
GRID_COST = 13 * COST[NPY]
"""… and of a grid, where one byte is a measurement, which takes 13 in a table."""
BLOCK = 1 << 18
"""Rows that are checked at once."""


@dataclass(frozen=True)
class Body:
    """The unpacked bytes of a post, their media type, and the time of all that is in them where that is sent beside."""

    content: Content
    media_type: str
    time: float | None = None

    @cached_property
    def digest(self) -> bytes:
        """What tells two bodies apart, 128 bits; a fifth of the cost of SHA-256, and no secret hangs on it."""
        digest = xxhash.xxh3_128(self._beside.encode() + b"\0")
        digest.update(self.content)
        return digest.digest()

    @property
    def cost(self) -> int:
        """Bytes of memory that each byte of it takes at most until its measurements are stored; its own included."""
        if self.media_type == NPY and self.time is not None:
            return GRID_COST
        return COST.get(self.media_type, 1)

    @property
    def _beside(self) -> str:
        return self.media_type if self.time is None else f"{self.media_type} {self.time!r}"


@dataclass(frozen=True, slots=True)
class Target:
    """What the measurements are for: the location's kind and grid, and the latest time they may have."""

    kind: str
    grid: GridGeometry
    latest: float


LARGE_JSON_BYTES = 1 << 18
"""JSON from here on is read in pieces."""


def _read_json(content: Content, kind: str, grid: GridGeometry) -> Columns:
    if len(content) < LARGE_JSON_BYTES:
        return json_body.read(content, kind, grid)
    return large_json.read(content, kind, grid)


READERS: dict[str, Callable[[Content, str, GridGeometry], Columns]] = {
    JSON: _read_json,
    ARROW: arrow_body.read,
    NPY: npy_body.read,
}


def parse(body: Body, target: Target) -> Measurements:
    """The measurements of a body, in order (`Measurements.in_order`).

    Raises UnsupportedMediaTypeError, UnreadableBodyError, InvalidInputError naming the first offending place.
    """
    columns = _columns(body, target)
    if not len(columns.time):
        raise InvalidInputError.at(columns.whole, "there is no measurement in it; send at least one")
    look = sort_snapshot(columns.time, columns.cell, columns.state, (-FARTHEST_S, target.latest), target.grid.n_cells)
    return _in_order(columns, target) if look is None else look


def _in_order(columns: Columns, target: Target) -> Measurements:
    """Measurements of any kind."""
    for start in range(0, len(columns.time), BLOCK):
        _check(columns, start, target)
    measurements = Measurements(
        columns.time, columns.cell.astype(np.uint32, copy=False), columns.state.astype(np.uint8, copy=False)
    ).in_order()
    if _contradict(measurements).any():
        raise InvalidInputError.at(_contradiction(columns), "this cell is both occupied and free at the same time")
    return measurements


def _columns(body: Body, target: Target) -> Columns:
    """What stands in a body, unchecked."""
    reader = READERS.get(body.media_type)
    if reader is None:
        raise UnsupportedMediaTypeError(
            f"Content-Type {body.media_type!r} is not read here; send one of {', '.join(READERS)}."
        )
    if body.time is None:
        return reader(body.content, target.kind, target.grid)
    if body.media_type != NPY:
        raise InvalidInputError.at("time", f"only a grid as {NPY} has its time here; leave it out")
    return npy_body.read_grid(body.content, target.grid, body.time)


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
    says = f"cells are 0 to {n_cells - 1} here, and indices [i,j,k] lie within the shape {list(target.grid.shape)}"
    refuse((cell < 0) | (cell >= n_cells), columns.cell_field, says)


def _refuse(start: int, wrong: NDArray[np.bool_], field: Callable[[int], str], message: str) -> None:
    if wrong.any():
        raise InvalidInputError.at(field(start + int(np.argmax(wrong))), message)


def _contradict(measurements: Measurements) -> NDArray[np.bool_]:
    """(n - 1,) which of them, in order, say the opposite of the one before at the same time of the same cell."""
    time, cell, state = measurements.time, measurements.cell, measurements.state
    return np.asarray((state[1:] != state[:-1]) & (cell[1:] == cell[:-1]) & (time[1:] == time[:-1]))


def _contradiction(columns: Columns) -> str:
    """The place of the first measurement, as they were sent, that contradicts an earlier one."""
    order = np.lexsort((columns.cell, columns.time))
    cell, state = columns.cell[order].astype(np.uint32), columns.state[order].astype(np.uint8)
    clash = _contradict(Measurements(columns.time[order], cell, state))
    return columns.cell_field(int(order[int(np.argmax(clash)) + 1]))

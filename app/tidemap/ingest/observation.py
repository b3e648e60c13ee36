"""Posted observations: columns as they were sent to measurements, refusing what is wrong by name."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import InvalidInputError
from tidemap.history.columns import STATE_MESSAGE, Columns
from tidemap.history.measurements import UNAVAILABLE, Measurements
from tidemap.history.snapshot import sort_snapshot
from tidemap.schemas.common import FARTHEST_S
from tidemap.space.grid import GridGeometry

TOO_OLD = (
    "this lies too far in the past; check the robot's clock and that times are in seconds, "
    "or raise TIDEMAP_PAST_S on the server to take an older archive"
)
STATES = ("free", "occupied", "unavailable")
BLOCK = 1 << 18
"""Rows that are checked at once."""


@dataclass(frozen=True, slots=True)
class Target:
    """What the measurements are for: the location's grid, and the times they may have, from `earliest` to `latest`."""

    grid: GridGeometry
    earliest: float
    latest: float


def checked(columns: Columns, target: Target) -> Measurements:
    """What was sent as measurements, in order (`Measurements.in_order`).

    Raises InvalidInputError naming the first field that is wrong.
    """
    if not len(columns.time):
        raise InvalidInputError.at(columns.whole, "there is no measurement in it; send at least one")
    times = (max(target.earliest, -FARTHEST_S), target.latest)
    if columns.unavailable is not None:
        return _in_order(columns, target)
    snapshot = sort_snapshot(columns.time, columns.cell, columns.state, times, target.grid.n_cells)
    return _in_order(columns, target) if snapshot is None else snapshot


def check_time(time: float, target: Target) -> None:
    """Raise InvalidInputError for a time that no measurement may have."""
    nothing = np.zeros(1, np.int64)
    _check(Columns(np.array([time]), nothing, nothing, _time, _time, _time, "time"), 0, target)


def _time(_: int) -> str:
    return "time"


def _in_order(columns: Columns, target: Target) -> Measurements:
    """Measurements of any kind."""
    for start in range(0, len(columns.time), BLOCK):
        _check(columns, start, target)
    measurements = Measurements(columns.time, columns.cell.astype(np.uint32, copy=False), _states(columns)).in_order()
    wrong = _contradict(measurements)
    if wrong.any():
        row = int(np.argmax(wrong))
        one, other = (STATES[int(state)] for state in measurements.state[[row + 1, row]])
        message = f"this cell is both {one} and {other} at the same time"
        raise InvalidInputError.at(_contradiction(columns), message)
    return measurements


def _states(columns: Columns) -> NDArray[np.uint8]:
    """(n,) uint8: 0, 1, or UNAVAILABLE."""
    state = columns.state.astype(np.uint8, copy=False)
    return state if columns.unavailable is None else np.where(columns.unavailable, np.uint8(UNAVAILABLE), state)


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
    refuse((state < 0) | (state > 1), columns.state_field, STATE_MESSAGE)
    n_cells = target.grid.n_cells
    says = f"cells are 0 to {n_cells - 1} here, and indices [i,j,k] lie within the shape {list(target.grid.shape)}"
    refuse((cell < 0) | (cell >= n_cells), columns.cell_field, says)
    refuse(time < target.earliest, columns.time_field, TOO_OLD)


def _refuse(start: int, wrong: NDArray[np.bool_], field: Callable[[int], str], message: str) -> None:
    if wrong.any():
        raise InvalidInputError.at(field(start + int(np.argmax(wrong))), message)


def _contradict(measurements: Measurements) -> NDArray[np.bool_]:
    """(n - 1,) which of them, in order, say the opposite of the one before at the same time of the same cell."""
    time, cell, state = measurements.time, measurements.cell, measurements.state
    return np.asarray((state[1:] != state[:-1]) & (cell[1:] == cell[:-1]) & (time[1:] == time[:-1]))


def _contradiction(columns: Columns) -> str:
    """The field of the first measurement, as they were sent, that contradicts an earlier one."""
    order = np.lexsort((columns.cell, columns.time))
    cell, state = columns.cell[order].astype(np.uint32), _states(columns)[order]
    clash = _contradict(Measurements(columns.time[order], cell, state))
    return columns.cell_field(int(order[int(np.argmax(clash)) + 1]))

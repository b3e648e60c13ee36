"""The truth about a history as plainly as it can be said: a dictionary of what stands."""

from collections.abc import Iterable

import numpy as np

from tidemap.history.measurements import Measurements
from tidemap.history.timebase import TimeBase

Row = tuple[float, int, int]
"""(time in Unix seconds, cell, state)."""
Truth = dict[tuple[int, int], tuple[float, int]]
"""By (cell, sample): the time and the state of the measurement that stands."""


def put(truth: Truth, rows: Iterable[Row], base: TimeBase, combine: str = "latest") -> None:
    """Add measurements: the latest time stands, of two at the same time the occupied one; or any occupied one."""
    for time, cell, state in rows:
        key = (cell, int(base.sample(time)))
        readings = [truth.get(key, (time, state)), (time, state)]
        truth[key] = max(readings) if combine == "latest" else max(readings, key=lambda reading: reading[::-1])


def measurements_of(rows: Iterable[Row]) -> Measurements:
    """The rows as columns, in their order."""
    listed = list(rows)
    time, cell, state = zip(*listed, strict=True) if listed else ((), (), ())
    return Measurements(np.array(time, np.float64), np.array(cell, np.uint32), np.array(state, np.uint8))


def states_of(truth: Truth, cells: range, start: int, stop: int) -> np.ndarray:
    """Dense (cells, stop - start) states as `History.states` gives them."""
    dense = np.full((len(cells), stop - start), 2, np.uint8)
    for (cell, sample), (_, state) in truth.items():
        if cell in cells and start <= sample < stop:
            dense[cell - cells.start, sample - start] = state
    return dense


def share(occupied: int, observed: int) -> float:
    """The share of readings that are occupied, half a visit of each state added."""
    return (occupied + 0.5) / (observed + 1)

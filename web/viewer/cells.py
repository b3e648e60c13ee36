"""What a state looks like: which cells are shown and in which colour. Pure arrays in, pure arrays out."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from web.viewer import colors

SEEN_OCCUPIED = 1
SEEN_FREE = 0


class StateArrays(Protocol):
    """The part of a state at a time that is drawn; n cells that have ever been observed."""

    @property
    def time(self) -> float: ...
    @property
    def confidence(self) -> float: ...
    @property
    def shape(self) -> Sequence[int]: ...
    @property
    def cell(self) -> NDArray[np.int64]: ...
    @property
    def probability(self) -> NDArray[np.float32]: ...
    @property
    def observed(self) -> NDArray[np.uint8] | None: ...
    @property
    def observed_time(self) -> NDArray[np.float64] | None: ...


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """Cells to draw: `index` (n, 3) in grid steps, `color` (n, 3), `row` (n,) into the state's arrays."""

    index: NDArray[np.int32]
    color: NDArray[np.uint8]
    row: NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """Both grids at one time, and how many cells carry which mark."""

    predicted: Cloud
    observed: Cloud
    unexpected: int
    missing: int
    stale: int


def index_of(cell: NDArray[np.int64], shape: Sequence[int]) -> NDArray[np.int32]:
    """Grid indices (n, 3) of linear cells (n,) in C order of `shape`; a flat grid has k = 0.

    >>> index_of(np.array([5]), [2, 3]).tolist(), index_of(np.array([5]), [1, 2, 4]).tolist()
    ([[1, 2, 0]], [[0, 1, 1]])
    """
    full = (*shape, 1, 1)[:3]
    return np.stack(np.unravel_index(cell, full), axis=1).astype(np.int32)


def picture(state: StateArrays, index: NDArray[np.int32], floor: float, fresh_s: float) -> Picture:
    """Both grids: predicted cells with p >= `floor`, and what was last seen at the state's time.

    `index` (n, 3) are the grid indices of the state's cells. A cell is judged (and may be marked) only when it
    was seen within `fresh_s` seconds before the state's time: an older sighting says nothing about now.
    """
    predicted = _predicted(state, index, floor)
    seen, fresh = _sightings(state, fresh_s)
    occupied = seen == SEEN_OCCUPIED
    surprise = np.abs(state.probability - seen) > state.confidence
    unexpected = fresh & occupied & surprise
    missing = fresh & (seen == SEEN_FREE) & surprise
    stale = occupied & ~fresh
    color = np.empty((len(index), 3), dtype=np.uint8)
    color[:] = colors.OCCUPIED
    color[stale] = colors.STALE
    color[unexpected] = colors.UNEXPECTED
    color[missing] = colors.MISSING
    observed = _cloud(index, color, occupied | missing)
    return Picture(predicted, observed, int(unexpected.sum()), int(missing.sum()), int(stale.sum()))


def _predicted(state: StateArrays, index: NDArray[np.int32], floor: float) -> Cloud:
    return _cloud(index, colors.of_probability(state.probability), state.probability >= floor)


def _cloud(index: NDArray[np.int32], color: NDArray[np.uint8], shown: NDArray[np.bool_]) -> Cloud:
    row = np.flatnonzero(shown)
    return Cloud(index[row], color[row], row)


def _sightings(state: StateArrays, fresh_s: float) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """What was last seen (2 = nothing) and whether that is fresh enough to judge."""
    if state.observed is None or state.observed_time is None:
        nothing = np.full(len(state.cell), 2, dtype=np.uint8)
        return nothing, np.zeros(len(state.cell), dtype=np.bool_)
    with np.errstate(invalid="ignore"):
        age_s = state.time - state.observed_time
    return state.observed, (state.observed != 2) & (age_s <= fresh_s)

"""What a state looks like: which cells are shown and in which colour. Pure arrays in, pure arrays out."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tidemap.space.grid import GridGeometry
from tidemap_web.viewer import colors

SEEN_OCCUPIED = 1
SEEN_FREE = 0
ALWAYS = 0.95
"""Mean probability from which on a cell counts as always occupied."""


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


@dataclass(frozen=True, slots=True)
class Taste:
    """What to show: predicted cells with p >= `floor`; sightings up to `fresh_s` old are judged."""

    floor: float
    fresh_s: float


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """Both grids at one time, and how many cells carry which mark."""

    predicted: Cloud
    observed: Cloud
    unexpected: int
    missing: int
    stale: int
    structure: int


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """What stays from one time to the next: `index` (n, 3) in grid steps and `grey` (n,), colours by height."""

    index: NDArray[np.int32]
    grey: NDArray[np.uint16]

    @classmethod
    def of(cls, grid: GridGeometry, cell: NDArray[np.int64]) -> "Ground":
        """The ground of linear cells (n,)."""
        index = grid.index(cell).astype(np.int32)
        return cls(index, colors.code_of_height(_height(index)))


def picture(state: StateArrays, ground: Ground, usual: NDArray[np.float32] | None, taste: Taste) -> Picture:
    """Both grids: what is likely, and what was last seen at the state's time.

    `usual` (n,) are the mean probabilities of the state's cells over all times; with it, what is always occupied
    is grey in both grids, and only what changes is coloured. A cell is judged (and may be marked) only when it
    was seen recently: an older sighting says nothing about now. Some 5 ms for 100,000 cells.
    """
    structure = _structure(state, usual)
    seen, fresh = _sightings(state, taste.fresh_s)
    occupied = seen == SEEN_OCCUPIED
    surprise = fresh & (np.abs(state.probability - occupied) > state.confidence)
    unexpected = surprise & occupied
    missing = surprise & ~occupied
    stale = occupied & ~fresh & ~structure
    # Before there is a model no probability is known, and none is shown.
    likely = np.nan_to_num(state.probability)
    predicted = np.where(structure, ground.grey, colors.code_of_probability(likely))
    observed = np.where(structure, ground.grey, colors.CODE_OCCUPIED)
    observed[stale] = colors.CODE_STALE
    observed[unexpected] = colors.CODE_UNEXPECTED
    observed[missing] = colors.CODE_MISSING
    return Picture(
        predicted=_cloud(ground, predicted, state.probability >= taste.floor),
        observed=_cloud(ground, observed, occupied | missing),
        unexpected=int(unexpected.sum()),
        missing=int(missing.sum()),
        stale=int(stale.sum()),
        structure=int(structure.sum()),
    )


def _structure(state: StateArrays, usual: NDArray[np.float32] | None) -> NDArray[np.bool_]:
    """Where a cell is always occupied, and now too."""
    if usual is None:
        return np.zeros(len(state.cell), dtype=np.bool_)
    return (usual >= ALWAYS) & (state.probability >= ALWAYS)


def _height(index: NDArray[np.int32]) -> NDArray[np.float64]:
    """Height (n,) of cells from 0 (lowest layer) to 1 (highest); 0.5 where there is one layer."""
    k = index[:, 2].astype(np.float64)
    low, high = (k.min(), k.max()) if len(k) else (0.0, 0.0)
    return (k - low) / (high - low) if high > low else np.full(len(k), 0.5)


def _cloud(ground: Ground, code: NDArray[np.uint16], shown: NDArray[np.bool_]) -> Cloud:
    row = np.flatnonzero(shown)
    return Cloud(ground.index[row], colors.PALETTE[code[row]], row)


def _sightings(state: StateArrays, fresh_s: float) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """What was last seen (2 = nothing) and whether that is fresh enough to judge."""
    if state.observed is None or state.observed_time is None:
        nothing = np.full(len(state.cell), 2, dtype=np.uint8)
        return nothing, np.zeros(len(state.cell), dtype=np.bool_)
    with np.errstate(invalid="ignore"):
        age_s = state.time - state.observed_time
    return state.observed, (state.observed != 2) & (age_s <= fresh_s)

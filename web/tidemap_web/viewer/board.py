"""The board: the cells of one grid at one revision in tiles, and the colour each has now."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tidemap.history.history import NEVER, UNOBSERVED
from tidemap.history.timebase import TimeBase
from tidemap.services.context import Seen
from tidemap.services.map_view import MapView, usual
from tidemap.space.grid import GridGeometry
from tidemap_web.viewer import colors
from tidemap_web.viewer.layers import (
    AGES_S,
    DIFFERENCE,
    OBSERVED,
    OVERLAY_MARKS,
    PREDICTED,
    Layer,
    LayoutName,
    ObservedName,
    PredictedName,
)
from tidemap_web.viewer.layout import Bounds
from tidemap_web.viewer.painting import (
    BLOCK,
    BY_AGE,
    COUNTS,
    HIDDEN,
    IS_MISSING,
    IS_STALE,
    IS_UNEXPECTED,
    IS_WALL,
    MARKS,
    SHOWN_LEFT,
    SHOWN_RIGHT,
    TILE,
    due,
    paint,
)

ALWAYS: Final = 0.95
"""Probability without any rhythm from which on a cell counts as always occupied."""
EXACT_FLOAT16: Final = 1024
"""Halves of numbers up to this are exact in float16."""
NO_LAYER: Final = Layer(-1, np.zeros(1, np.uint16), walls=False)
NO_SWING: Final = np.zeros(1, np.float32)
Crop = tuple[int, int, int, int, int, int]
"""The lowest [i, j, k] that is shown, and the highest."""
WHOLE: Final[Crop] = (0, 0, 0, 65535, 65535, 65535)


@dataclass(frozen=True, slots=True)
class Taste:
    """What to show: predicted cells with p >= `floor`, within `crop`; sightings up to `fresh_s` old are judged. With
    `dim` what is always occupied is grey, and only what changes is coloured."""

    floor: float = 0.1
    fresh_s: float = 3600.0
    dim: bool = True
    crop: Crop = WHOLE
    layout: LayoutName = "beside"
    predicted: PredictedName = "probability"
    observed: ObservedName = "seen"

    def layers(self) -> tuple[Layer, Layer]:
        """Of the left grid and of the right one; `NO_LAYER` shows nothing."""
        if self.layout == "difference":
            return DIFFERENCE, NO_LAYER
        right = OBSERVED[self.observed] if self.layout == "beside" else NO_LAYER
        return PREDICTED[self.predicted], right

    def over(self) -> NDArray[np.uint16]:
        """(MARKS,) codes that an overlay puts over the left grid."""
        codes = np.full(MARKS, HIDDEN, np.uint16)
        if self.layout == "overlay":
            codes[list(OVERLAY_MARKS)] = list(OVERLAY_MARKS.values())
        return codes


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """Which tiles have changed, (2, n_tiles) of `painting`'s bits, how many cells the left grid and the right one show,
    and how many carry which mark."""

    changed: NDArray[np.uint8]
    shown: tuple[int, int]
    unexpected: int
    missing: int
    stale: int
    structure: int


@dataclass(frozen=True, slots=True, eq=False)
class _Given:
    """What all cells are painted by. sample: the one that is shown, where a layer asks for ages."""

    taste: Taste
    confidence: float
    sample: int
    swing: NDArray[np.float32]

    def same_as(self, other: "_Given") -> bool:
        """Whether that is the same."""
        mine, others = ((each.taste, each.confidence, each.sample) for each in (self, other))
        return mine == others and self.swing is other.swing


@dataclass(frozen=True, slots=True, eq=False)
class _Painted:
    """What was painted last."""

    given: _Given
    probability: NDArray[np.float32]
    seen: Seen


class Board:
    """The cells that have been observed, those that have a rhythm first: a step in time touches few tiles.

    `index` (n, 3) in grid steps, `cell` (n,) their numbers; `codes` (2, n): of the left grid and of the right one.
    """

    def __init__(self, grid: GridGeometry, view: MapView) -> None:
        self.grid = grid
        self.loaded = view.loaded
        changing = np.zeros(grid.n_cells, np.bool_)
        changing[view.loaded.spectrum.cell] = True
        known = view.loaded.known
        self.cell = np.concatenate((known[changing[known]], known[~changing[known]])).astype(np.int32)
        self.index = grid.index(self.cell).astype(np.int32)
        self.bounds = Bounds.of(grid, self.index)
        exact = max(grid.shape) <= EXACT_FLOAT16
        self.precision = np.dtype(np.float16 if exact else np.float32)
        self._point = (self.index + 0.5).astype(self.precision)
        self._grey = colors.code_of_height(_height(self.index))
        self._inside: NDArray[np.bool_] = np.ones(len(self.cell), np.bool_)
        self._crop = WHOLE
        self._always = usual(view.loaded) >= ALWAYS
        self._unseen = Seen(np.full(grid.n_cells, UNOBSERVED, np.uint8), np.full(grid.n_cells, NEVER, np.int64))
        self._row: NDArray[np.int32] | None = None
        self.codes = np.full((2, len(self.cell)), HIDDEN, np.uint16)
        n_blocks = -(-len(self.cell) // BLOCK)
        self._holds = np.zeros((2, n_blocks), np.int64)
        self._counts = np.zeros((n_blocks, COUNTS), np.int64)
        self._before: _Painted | None = None

    @property
    def n_tiles(self) -> int:
        """Tiles of one grid."""
        return -(-len(self.cell) // TILE)

    def paint(self, view: MapView, seen: Seen | None, taste: Taste, swing: NDArray[np.float32] = NO_SWING) -> Picture:
        """Colour every cell for a view of this revision: 10 ns for one in a block that can have changed, 2 in another.

        swing (n_cells,): the amplitude of p over the day, where a layer shows it.
        """
        seen, moment = seen or self._unseen, _samples(view.location.base, view.time, taste.fresh_s)
        left, right = taste.layers()
        given = _Given(taste, view.confidence, moment[1] if BY_AGE in (left.source, right.source) else 0, swing)
        changed = np.zeros((2, self.n_tiles), np.uint8)
        paint(
            self._due(given, view.probability, seen, moment[0]),
            *(self.cell, self._grey, self._within(taste.crop)),
            view.probability,
            swing,
            seen.state,
            seen.sample,
            self._always,
            (np.float32(view.confidence), np.float32(1 - view.confidence), np.float32(taste.floor)),
            moment,
            taste.dim,
            (left.source, right.source),
            (left.walls, right.walls),
            *(left.table, right.table, taste.over()),
            np.ceil(np.array(AGES_S) / view.location.base.interval_s).astype(np.int64),
            self.codes,
            *(self._holds, self._counts),
            changed,
        )
        counts = self._counts.sum(axis=0).tolist()
        return Picture(
            changed,
            shown=(counts[SHOWN_LEFT], counts[SHOWN_RIGHT]),
            unexpected=counts[IS_UNEXPECTED],
            missing=counts[IS_MISSING],
            stale=counts[IS_STALE],
            structure=counts[IS_WALL],
        )

    def _due(self, given: "_Given", p: NDArray[np.float32], seen: Seen, oldest: int) -> NDArray[np.bool_]:
        """(n_blocks,) the blocks of cells that can look other than when they were painted last."""
        before, self._before = self._before, _Painted(given, p, seen)
        blocks = np.ones(len(self._counts), np.bool_)
        if before is not None and before.given.same_as(given):
            cells = (before.probability, before.seen.state, before.seen.sample)
            due(self.cell, p, seen.state, seen.sample, *cells, oldest, self._holds, blocks)
        return blocks

    def _within(self, crop: Crop) -> NDArray[np.bool_]:
        """Which cells are not cut away: worked out once a crop."""
        if crop != self._crop:
            self._inside = np.asarray(((self.index >= crop[:3]) & (self.index <= crop[3:])).all(axis=1))
            self._crop = crop
        return self._inside

    def shown(self, side: int, tile: int | None = None) -> NDArray[np.intp]:
        """The rows that one grid, or one tile of it, shows."""
        first = 0 if tile is None else tile * TILE
        stop = None if tile is None else first + TILE
        return first + np.flatnonzero(self.codes[side, first:stop] != HIDDEN)

    def shown_of(self, side: int, cells: NDArray[np.int64]) -> NDArray[np.intp]:
        """The rows of those of some cells that one grid shows."""
        if self._row is None:
            self._row = np.full(self.grid.n_cells, -1, np.int32)
            self._row[self.cell] = np.arange(len(self.cell))
        rows = self._row[cells].astype(np.intp)
        rows = rows[rows >= 0]
        return np.asarray(rows[self.codes[side, rows] != HIDDEN])

    def points(self, rows: NDArray[np.intp]) -> NDArray[np.floating]:
        """(m, 3) the centres of cells in grid steps."""
        return self._point[rows]

    def colors(self, side: int, rows: NDArray[np.intp]) -> NDArray[np.uint8]:
        """(m, 3) what one grid shows them in."""
        return np.asarray(colors.PALETTE[self.codes[side, rows]], np.uint8)


def _height(index: NDArray[np.int32]) -> NDArray[np.float64]:
    """Height (n,) of cells from 0 (lowest layer) to 1 (highest); 0.5 where there is one layer."""
    k = index[:, 2].astype(np.float64)
    low, high = (k.min(), k.max()) if len(k) else (0.0, 0.0)
    return (k - low) / (high - low) if high > low else np.full(len(k), 0.5)


def _samples(base: TimeBase, time: float, fresh_s: float) -> tuple[int, int]:
    """The oldest sample that is judged at a time, by its start, and the one that is shown."""
    return math.ceil((time - fresh_s - base.epoch) / base.interval_s), int(base.sample(time))


def warm() -> None:
    """Compile what paints, or load it from the cache on disk, before somebody waits for it."""
    none, codes, tiles = np.zeros(1, np.uint16), np.zeros((2, 1), np.uint16), np.zeros((2, 1), np.uint8)
    number, block, p = np.zeros(1, np.int32), np.ones(1, np.bool_), np.ones(1, np.float32)
    state, sample, holds = np.zeros(1, np.uint8), np.zeros(1, np.int64), np.zeros((2, 1), np.int64)
    limits, over, counts = (np.float32(0.5),) * 3, np.zeros(MARKS, np.uint16), np.zeros((1, COUNTS), np.int64)
    layers = ((-1, -1), (False, False), none, none)
    known = (p, NO_SWING, state, sample, np.zeros(1, np.bool_))
    paint(block, number, none, block, *known, limits, (0, 0), False, *layers, over, sample, codes, holds, counts, tiles)
    due(number, p, state, sample, p, state, sample, 0, holds, block)

"""Rows as the services see them."""

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import RowMapping

from tidemap.errors import CorruptChunkError
from tidemap.history.chunks import CHUNK_CELLS
from tidemap.history.timebase import TimeBase
from tidemap.history.values import ValueKind
from tidemap.space.grid import SINGLE, Extent, GridGeometry
from tidemap.space.pose import FramedPosition
from tidemap.spectral.conditioning import UNLEARNED, Persistence
from tidemap.spectral.recipe import Recipe
from tidemap.storage.blobs import unpack_json

KINDS = {
    "state": (Extent.SINGLE, ValueKind.STATE),
    "grid2d": (Extent.PLANE, ValueKind.STATE),
    "grid3d": (Extent.VOLUME, ValueKind.STATE),
}
"""What a location's `kind` says of how its cells lie, and of what they hold."""


@dataclass(frozen=True)
class LocationRecord:
    """A location's settings and counters. `order` None means that `auto` chooses it."""

    id: int
    name: str
    kind: str
    interval_s: float
    time_zone: str
    epoch: float
    grid: GridGeometry | None
    estimator: str
    order: int | None
    confidence: float
    missing: str
    hold_s: float | None
    combine: str
    retention_s: float | None
    min_cells: int
    calendar: str | None
    pose: FramedPosition | None
    created_at: float
    observation_seq: int
    compacted_seq: int
    measurements: int
    deleted: int
    first_time: float | None
    last_time: float | None
    revision: int

    @classmethod
    def of(cls, row: RowMapping) -> "LocationRecord":
        """From a row of the table."""
        return cls(**{**row, "grid": grid_of(row["grid"]), "pose": position_of(row["pose"])})

    @property
    def extent(self) -> Extent:
        """How its cells lie. Raises ValueError for a kind that is not known."""
        return self._meaning[0]

    @property
    def value(self) -> ValueKind:
        """What its cells hold. Raises ValueError for a kind that is not known."""
        return self._meaning[1]

    @property
    def _meaning(self) -> tuple[Extent, ValueKind]:
        if self.kind not in KINDS:
            raise ValueError(f"{self.kind!r} is no kind of location")
        return KINDS[self.kind]

    @cached_property
    def base(self) -> TimeBase:
        """The time base of its samples."""
        return TimeBase(self.epoch, self.interval_s)

    @cached_property
    def cells(self) -> GridGeometry:
        """Its grid; without one, its one cell."""
        return self.grid or SINGLE

    @property
    def observations(self) -> int:
        """Measurements that were posted and not deleted since."""
        return self.measurements - self.deleted

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return self.cells.n_cells

    @property
    def n_chunks(self) -> int:
        """Number of chunks of cells it is stored in."""
        return -(-self.n_cells // CHUNK_CELLS)

    def chunk_size(self, chunk: int) -> int:
        """Number of cells in a chunk; the last may be smaller."""
        return min(CHUNK_CELLS, self.n_cells - chunk * CHUNK_CELLS)

    def cell_ranges(self, chunks: Iterable[int]) -> list[tuple[int, int]]:
        """The cells of some chunks as ranges [first, stop), ascending; neighbouring ones are one."""
        ranges: list[tuple[int, int]] = []
        for chunk in sorted(chunks):
            first = chunk * CHUNK_CELLS
            begin = ranges.pop()[0] if ranges and ranges[-1][1] == first else first
            ranges.append((begin, first + self.chunk_size(chunk)))
        return ranges

    @property
    def hold_samples(self) -> int | None:
        """How many samples a state stands, None where unobserved samples are masked."""
        return round((self.hold_s or 0) / self.interval_s) if self.missing == "hold" else None


@lru_cache
def grid_of(text: str | None) -> GridGeometry | None:
    """A grid from its stored JSON."""
    if text is None:
        return None
    value = json.loads(text)
    return GridGeometry(value["frame"], tuple(value["origin"]), value["resolution_m"], tuple(value["shape"]))


@lru_cache
def position_of(text: str | None) -> FramedPosition | None:
    """A position from its stored JSON."""
    if text is None:
        return None
    value = json.loads(text)
    return FramedPosition(value["frame"], tuple(value["position"]))


def text_of(value: GridGeometry | FramedPosition | None) -> str | None:
    """A grid or a position as the JSON that is stored of it."""
    return None if value is None else json.dumps(asdict(value), separators=(",", ":"), ensure_ascii=False)


@dataclass(frozen=True)
class RevisionRecord:
    """One update: samples [start, stop) were fitted; `observation_seq` and `measurements` were known then.

    persistence: how long states last, as the update learned it; by default what is believed without having learned.
    """

    location_id: int
    revision: int
    recipe: Recipe
    start: int
    stop: int
    observation_seq: int
    measurements: int
    accuracy: float | None
    updated_at: float
    selection: dict[str, Any] | None
    persistence: Persistence = UNLEARNED

    @classmethod
    def of(cls, row: RowMapping) -> "RevisionRecord":
        """From a row of the table."""
        what = f"revision {row['revision']}"
        recipe = Recipe.from_dict(unpack_json(row["recipe"], f"the recipe of {what}"))
        selection = row["selection"] and unpack_json(row["selection"], f"the selection of {what}")
        learned = row["persistence"]
        persistence = Persistence(**unpack_json(learned, f"the persistence of {what}")) if learned else UNLEARNED
        return cls(**{**row, "recipe": recipe, "selection": selection, "persistence": persistence})

    @property
    def estimator(self) -> str:
        """The estimator it was fitted by."""
        return self.recipe.estimator

    @property
    def order(self) -> int:
        """The order it was fitted at."""
        return self.recipe.order


@dataclass(frozen=True)
class ObservationRecord:
    """A posted observation before it is stored."""

    received_at: float
    source: str | None
    measurements: int
    first_time: float
    last_time: float
    idempotency_key: str | None
    body_hash: bytes | None
    payload: bytes


@dataclass(frozen=True, eq=False)
class AnomalyRecord:
    """An event; `id` is 0 until it is stored. `cells` are empty where `damage` says that they cannot be read."""

    location_id: int
    id: int
    start: float
    stop: float
    cells: NDArray[np.int64]
    observed: int
    probability: float
    surprise: float
    confidence: float
    rule: str
    revision: int
    acknowledged_by: str | None = None
    acknowledged_at: float | None = None
    note: str | None = None
    damage: CorruptChunkError | None = None


@dataclass(frozen=True)
class JobRecord:
    """Long work; `request` and `result` are plain JSON values."""

    location_id: int
    location: str
    id: int
    kind: str
    state: str
    progress: float
    request: dict[str, Any]
    error: str | None
    result: dict[str, Any] | None
    created_at: float
    finished_at: float | None


@dataclass(frozen=True)
class KeyRecord:
    """A key; only the hash of its secret is known."""

    id: int
    name: str
    role: str
    prefix: str
    hash: bytes
    created_at: float

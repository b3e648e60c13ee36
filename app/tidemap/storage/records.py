"""Rows as the services see them."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property, lru_cache
from typing import Any, Final, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import RowMapping

from tidemap.errors import CorruptChunkError
from tidemap.history.chunks import CHUNK_CELLS
from tidemap.history.timebase import TimeBase
from tidemap.history.values import ValueKind
from tidemap.scope import EVERYWHERE, Scope
from tidemap.space.grid import SINGLE, Extent, GridGeometry
from tidemap.space.pose import FramedPosition
from tidemap.spectral.conditioning import UNLEARNED, Persistence
from tidemap.spectral.detector import Detector
from tidemap.spectral.recipe import Recipe
from tidemap.spectral.sensor import Sensor
from tidemap.storage.blobs import unpack_json, unpack_numbers

GAP_SAMPLES = 2
"""How many samples without a surprise an event outlasts, where its location does not say."""
SEEN_FREE, SEEN_OCCUPIED = 1, 2
"""What a cell of an event was seen as, when that was a surprise: bits, for it may have been both."""
KINDS = {
    "state": (Extent.SINGLE, ValueKind.STATE),
    "grid2d": (Extent.PLANE, ValueKind.STATE),
    "grid3d": (Extent.VOLUME, ValueKind.STATE),
}
"""What a location's `kind` says of how its cells lie, and of what they hold."""


LEARN: Final = "learn"
"""A location's `sensor` whose rates the updates learn."""
SensorSetting: TypeAlias = Sensor | Literal["learn"]
"""A location's `sensor`."""


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
    sensor: SensorSetting | None
    event_gap_s: float | None
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
    judged_to: float | None

    @classmethod
    def of(cls, row: RowMapping | Mapping[str, Any]) -> "LocationRecord":
        """From a row of the table."""
        own = {"grid": grid_of(row["grid"]), "pose": position_of(row["pose"]), "sensor": sensor_of(row["sensor"])}
        return cls(**{**row, **own})

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

    @property
    def gap_samples(self) -> int:
        """How many samples without a surprise an event outlasts."""
        return GAP_SAMPLES if self.event_gap_s is None else int(self.event_gap_s / self.interval_s + 1e-9)


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


@lru_cache
def sensor_of(text: str | None) -> SensorSetting | None:
    """A sensor from its stored JSON; ValueError or TypeError where it is none."""
    if text is None:
        return None
    value = json.loads(text)
    return LEARN if value == LEARN else Sensor(**value)


def text_of(value: GridGeometry | FramedPosition | SensorSetting | None) -> str | None:
    """A grid, a position or a sensor as the JSON that is stored of it."""
    if value is None:
        return None
    plain = value if isinstance(value, str) else asdict(value)
    return json.dumps(plain, separators=(",", ":"), ensure_ascii=False)


PERSISTENCE_VERSION: Final = 2
"""Of the stored form of how long states last; 1 knows no correction."""


@dataclass(frozen=True)
class RevisionRecord:
    """One update: samples [start, stop) were fitted; `observation_seq` and `measurements` were known then.

    persistence: how long states last, as the update learned it; by default what is believed without having learned.
    offset: by cell, where its ln (τ + κ a) differs from that.
    detector: the same as read by a sensor that errs, where the location had one.
    chunks: those that have a spectrum, ascending, as nothing was ever seen of the others; None: all.
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
    detector: Detector | None = None
    offset: Mapping[int, float] = field(default_factory=dict)
    chunks: NDArray[np.int64] | None = field(default=None, compare=False)

    @classmethod
    def of(cls, row: RowMapping) -> "RevisionRecord":
        """From a row of the table."""
        what = f"revision {row['revision']}"
        recipe = Recipe.from_dict(unpack_json(row["recipe"], f"recipe of {what}"))
        selection = row["selection"] and unpack_json(row["selection"], f"selection of {what}")
        lasting = f"persistence of {what}"
        learned = unpack_json(row["persistence"], lasting, PERSISTENCE_VERSION) if row["persistence"] else {}
        offset = {int(cell): float(value) for cell, value in learned.pop("offset", [])}
        read = row["detector"] and Detector.from_dict(unpack_json(row["detector"], f"detector of {what}"))
        known = {"persistence": Persistence.from_dict(learned) if learned else UNLEARNED, "offset": offset}
        chunks = None if row["chunks"] is None else unpack_numbers(row["chunks"], f"chunks of {what}")
        own = {"recipe": recipe, "selection": selection, "detector": read or None, "chunks": chunks}
        return cls(**{**row, **own, **known})

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


def bit_of(state: int) -> int:
    """SEEN_FREE or SEEN_OCCUPIED, of a state 0 or 1."""
    return SEEN_OCCUPIED if state else SEEN_FREE


@dataclass(frozen=True, eq=False)
class AnomalyRecord:
    """An event; `id` is 0 until it is stored. `cells` are empty where `damage` says that they cannot be read.

    seen (n,): SEEN_FREE, SEEN_OCCUPIED or both of each cell; None where all were as `observed` says.
    marks: how many surprising measurements `probability` is the mean of.
    part_of: the older event that it was found to be a part of.
    ended: nothing that is measured from now on continues it. change: the number of its latest change.
    muted: all of it lies in a time that was muted.
    """

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
    marks: int = 1
    part_of: int | None = None
    ended: bool = False
    change: int = 0
    muted: bool = False
    snoozed_by: str | None = None
    snoozed_until: float | None = None
    seen: NDArray[np.uint8] | None = None
    damage: CorruptChunkError | None = None

    @property
    def bits(self) -> NDArray[np.uint8]:
        """(n,) SEEN_FREE, SEEN_OCCUPIED or both of each cell."""
        return np.full(len(self.cells), bit_of(self.observed), np.uint8) if self.seen is None else self.seen


@dataclass(frozen=True)
class JobRecord:
    """Long work; `request` and `result` are plain JSON values. waiting: what keeps it from going on."""

    location_id: int
    location: str
    id: int
    kind: str
    state: str
    progress: float
    request: dict[str, Any]
    error: str | None
    waiting: str | None
    result: dict[str, Any] | None
    created_at: float
    finished_at: float | None


@dataclass(frozen=True)
class KeyRecord:
    """A key; only the hash of its secret is known. `rotated`: another one was made in its place."""

    id: int
    name: str
    role: str
    prefix: str
    hash: bytes
    created_at: float
    scope: Scope = EVERYWHERE
    expires_at: float | None = None
    last_used_at: float | None = None
    rotated: bool = False

    def expired(self, now: float) -> bool:
        """Whether it opens nothing any more."""
        return self.expires_at is not None and self.expires_at <= now


@dataclass(frozen=True, slots=True, kw_only=True)
class AuditEntry:
    """Somebody changed something: at a time (Unix seconds), by a request. `key_id` is None without a key."""

    request: str
    time: float
    actor: str
    key_id: int | None
    action: str
    target: str
    detail: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class AuditRecord(AuditEntry):
    """A stored entry."""

    id: int


@dataclass(frozen=True, slots=True, kw_only=True)
class WebhookRecord:
    """A receiver of the anomalies of a scope after `cursor`. Its secret is derived from `salt`."""

    id: int
    url: str
    description: str
    scope: Scope
    enabled: bool
    salt: bytes
    fingerprint: bytes
    cursor: int
    created_at: float


@dataclass(frozen=True, slots=True, kw_only=True)
class DeliveryRecord:
    """A change of an anomaly for a webhook: `state` is waiting (until `next_at`), delivered or failed.

    update: of an anomaly that the webhook has had before.
    """

    id: int
    webhook_id: int
    anomaly_id: int
    message_id: str
    state: str
    attempts: int
    next_at: float
    status: int | None
    error: str | None
    created_at: float
    finished_at: float | None
    update: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class MuteRecord:
    """Nobody hears of events of a scope in [start, stop); `weekly` the same of every later week, until `until`."""

    id: int
    scope: Scope
    start: float
    stop: float
    weekly: bool
    until: float | None
    note: str
    created_by: str
    created_at: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RhythmRecord:
    """When a location was heard: `heard` is packed, `last_heard` when last, of observations up to number `through`.

    silence: the event of the silence that goes on.
    """

    location_id: int
    through: int
    heard: bytes
    last_heard: float | None
    silence: int | None


@dataclass(frozen=True)
class ScanRecord:
    """A scan and what became of it; `id` is 0 until it is stored. `registration` is plain JSON.

    payload: its points, as long as it is in quarantine; n_bytes: what they take at most, packed or not.
    """

    location_id: int
    id: int
    observation: int | None
    time: float
    received_at: float
    source: str | None
    verdict: str
    registration: dict[str, Any]
    points: int
    idempotency_key: str | None
    body_hash: bytes | None
    n_bytes: int
    payload: bytes | None

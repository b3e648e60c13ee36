"""A state as the services answer it, and a source of such states."""

from collections.abc import Hashable, Sequence
from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from tests.support.records import location_record
from tidemap.errors import LocationNotFoundError
from tidemap.history.history import NEVER, UNOBSERVED
from tidemap.services.anomalies import Anomaly
from tidemap.services.building import PosedState
from tidemap.services.context import Loaded, Seen
from tidemap.services.films import Watch
from tidemap.services.locations import LocationSummary
from tidemap.services.map_view import MapQuery, MapView, day_of, unmodelled
from tidemap.services.robots import SensorTrack
from tidemap.services.spectra import Fitted
from tidemap.space.grid import GridGeometry
from tidemap.space.pose import Pose
from tidemap.spectral.recipe import Recipe
from tidemap.storage.records import LocationRecord

NOW = 1_800_000_000.0
DOOR = "door"
"""A location that is no grid."""
GRID = GridGeometry("map", (1.0, 2.0, 3.0), 0.5, (2, 3, 4))
PROBABILITY = {0: 1.0, 5: 0.5, 23: 0.02}
SEEN = {0: (1, NOW), 5: (0, NOW), 23: (1, NOW)}


def map_view(
    grid: GridGeometry,
    probability: dict[int, float],
    seen: dict[int, tuple[int, float]] | None = None,
    time: float = NOW,
    confidence: float = 0.9,
    mean: dict[int, float] | None = None,
) -> MapView:
    """A view of some cells of a grid; seen: state and time of each; mean: the probability without any rhythm."""
    record = location_record(name="lab", kind="grid3d", interval_s=1.0, grid=grid, last_time=NOW)
    p = np.full(grid.n_cells, np.nan, np.float32)
    p[list(probability)] = list(probability.values())
    without = np.where(np.isnan(p), p, np.float32(0.5))
    without[list(mean or {})] = list((mean or {}).values())
    blank = unmodelled(record, np.zeros(0, np.int64))
    revision = replace(blank.revision, revision=1, recipe=Recipe("fft", 2, "UTC"))
    loaded = Loaded(revision, replace(blank.spectrum, mean=without), {})
    sighted = Seen(np.full(grid.n_cells, UNOBSERVED, np.uint8), np.full(grid.n_cells, NEVER, np.int64))
    for cell, (state, at) in (seen or {}).items():
        sighted.state[cell], sighted.sample[cell] = state, record.base.sample(at)
    return MapView(record, loaded, time, confidence, p, sighted)


def location(name: str, last_time: float | None = NOW, kind: str = "grid3d") -> LocationSummary:
    """A grid as the services describe it."""
    record = location_record(
        name=name,
        kind=kind,
        time_zone="Europe/London",
        grid=GRID,
        observation_seq=3,
        measurements=3,
        first_time=None if last_time is None else NOW - 86400,
        last_time=last_time,
    )
    values = {each.name: getattr(record, each.name) for each in fields(record)}
    return LocationSummary(**values, updated_at=NOW, accuracy=0.9, open_anomalies=0)


class FakeSource:
    """Grids by name; what is in `without_model` has no revision yet."""

    def __init__(self, *names: str, without_model: tuple[str, ...] = ()) -> None:
        self.locations = {name: location(name) for name in names}
        self.without_model = without_model
        self.asked: list[MapQuery] = []
        self.at_hand = True
        self.days: list[float] = []
        self.doors: list[LocationRecord] = []
        self.scanned = False
        self._loaded: Loaded | None = None

    def now(self) -> float:
        return NOW

    def grids(self) -> list[LocationSummary]:
        return list(self.locations.values())

    def grid(self, name: str) -> LocationSummary:
        if name not in self.locations:
            raise LocationNotFoundError(name)
        return self.locations[name]

    def is_location(self, name: str) -> bool:
        return name in self.locations or name == DOOR

    def view(self, query: MapQuery, like: MapView | None) -> MapView:
        self.asked.append(query)
        view = map_view(GRID, PROBABILITY, SEEN, query.time, query.confidence or 0.9)
        if query.location in self.without_model:
            unknown = np.full(GRID.n_cells, np.nan, np.float32)
            return replace(view, loaded=unmodelled(view.location, np.array(sorted(SEEN))), probability=unknown)
        if self._loaded is None:
            self._loaded = view.loaded
        view = replace(view, loaded=self._loaded, location=replace(view.location, name=query.location))
        return view if self.at_hand else replace(view, seen=None)

    def first_update(self) -> int:
        return 100

    def window(self, query: MapQuery) -> Hashable:
        return query.location

    def load(self, query: MapQuery, watch: Watch) -> Seen | None:
        for share in np.linspace(0, 1, 11):
            watch(float(share))
        return map_view(GRID, PROBABILITY, SEEN, query.time).seen

    def events(self, name: str, start: float) -> list[Anomaly]:
        return []

    def day_amplitude(self, view: MapView) -> NDArray[np.float32]:
        self.days.append(day_of(view))
        return np.asarray(view.probability / 2, np.float32)

    def posed(self, frame: str) -> list[Fitted]:
        return [Fitted(door, unmodelled(door, np.zeros(1, np.int64))) for door in self.doors]

    def posed_at(self, models: Sequence[Fitted], time: float) -> list[PosedState]:
        return [PosedState(model.location, 0.5, 1, time) for model in models]

    def has_scans(self, location: LocationSummary) -> bool:
        return self.scanned

    def tracks(self, location: LocationSummary, start: float, stop: float) -> list[SensorTrack]:
        poses = [Pose.of([1.0, 2.0, float(i), 0, 0, 0, 1]) for i in range(2)]
        return [SensorTrack("spot", np.array([NOW - 60, NOW]), poses)]

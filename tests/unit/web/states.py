"""A state as the services answer it, and a source of such states."""

from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from tests.support.records import location_record
from tidemap.errors import LocationNotFoundError
from tidemap.services.anomalies import Anomaly
from tidemap.services.locations import LocationSummary
from tidemap.space.grid import GridGeometry
from tidemap_web.viewer.source import Question, UnmodelledState, ViewedState

NOW = 1_800_000_000.0


@dataclass(frozen=True, eq=False)
class FakeState:
    """Three cells of a [2, 3, 4] grid unless said otherwise."""

    time: float = NOW
    confidence: float = 0.9
    estimator: str = "fft"
    order: int = 2
    revision: int = 1
    shape: tuple[int, ...] = (2, 3, 4)
    cell: NDArray[np.int64] = field(default_factory=lambda: np.array([0, 5, 23]))
    probability: NDArray[np.float32] = field(default_factory=lambda: np.array([1.0, 0.5, 0.02], np.float32))
    observed: NDArray[np.uint8] | None = field(default_factory=lambda: np.array([1, 0, 1], np.uint8))
    observed_time: NDArray[np.float64] | None = field(default_factory=lambda: np.full(3, NOW))


def location(name: str, last_time: float | None = NOW, kind: str = "grid3d") -> LocationSummary:
    """A grid as the services describe it."""
    record = location_record(
        name=name,
        kind=kind,
        time_zone="Europe/London",
        grid=GridGeometry("map", (1.0, 2.0, 3.0), 0.5, (2, 3, 4)),
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
        self.asked: list[Question] = []

    def now(self) -> float:
        return NOW

    def grids(self) -> list[LocationSummary]:
        return list(self.locations.values())

    def grid(self, name: str) -> LocationSummary:
        if name not in self.locations:
            raise LocationNotFoundError(name)
        return self.locations[name]

    def state(self, question: Question) -> ViewedState:
        self.asked.append(question)
        confidence = question.confidence or 0.9
        if question.location in self.without_model:
            cell, now = np.array([0, 5, 23]), np.full(3, NOW)
            return UnmodelledState(question.time, confidence, (2, 3, 4), cell, np.array([1, 0, 1], np.uint8), now)
        return FakeState(time=question.time, confidence=confidence)

    def first_update(self) -> int:
        return 100

    def events(self, name: str, start: float) -> list[Anomaly]:
        return []

"""What the viewer asks the services for; one small face, so that sessions can be tested without a database."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import LocationNotFoundError, NoModelError
from tidemap.services import anomalies, locations, state
from tidemap.services.anomalies import Anomaly
from tidemap.services.context import Context
from tidemap.services.locations import LocationSummary
from tidemap.services.observed_map import observed_map
from tidemap_web.viewer.cells import StateArrays

MARKS = 500


class ViewedState(StateArrays, Protocol):
    """A state at a time with what it was computed from."""

    @property
    def revision(self) -> int: ...
    @property
    def estimator(self) -> str: ...
    @property
    def order(self) -> int: ...


@dataclass(frozen=True, slots=True)
class Question:
    """The state of a grid at a time, with what was last seen; None stands for the location's own choice."""

    location: str
    time: float
    confidence: float | None
    order: int | None
    observed: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class UnmodelledState:
    """What was last seen of cells (n,) before there is a model; revision 0."""

    time: float
    confidence: float
    shape: tuple[int, ...]
    cell: NDArray[np.int64]
    observed: NDArray[np.uint8]
    observed_time: NDArray[np.float64]
    revision: int = 0
    estimator: str = ""
    order: int = 0

    @property
    def probability(self) -> NDArray[np.float32]:
        """(n,) NaN."""
        return np.full(len(self.cell), np.nan, np.float32)


class Source(Protocol):
    """Everything a session needs to know."""

    def now(self) -> float:
        """Unix seconds."""

    def grids(self) -> list[LocationSummary]:
        """All locations that are grids, by name."""

    def grid(self, name: str) -> LocationSummary:
        """One of them. Raises LocationNotFoundError."""

    def state(self, question: Question) -> ViewedState:
        """Before the first revision what was last seen, with revision 0 and no probabilities (NaN)."""

    def first_update(self) -> int:
        """Measurements of a location from which on it has its first update."""

    def events(self, name: str, start: float) -> list[Anomaly]:
        """Anomalies since `start`, oldest first, at most MARKS."""


class Services:
    """The source over the services of a running server."""

    def __init__(self, ctx: Context) -> None:
        self._ctx = ctx

    def now(self) -> float:
        """Unix seconds."""
        return self._ctx.clock()

    def grids(self) -> list[LocationSummary]:
        """All locations that are grids, by name."""
        return [location for location in locations.list_locations(self._ctx) if location.grid is not None]

    def grid(self, name: str) -> LocationSummary:
        """One grid with what is known of it."""
        location = locations.get_location(self._ctx, name)
        if location.grid is None:
            raise LocationNotFoundError(name)
        return location

    def state(self, question: Question) -> ViewedState:
        """The state at a time."""
        query = state.StateQuery(
            time=question.time,
            confidence=question.confidence,
            order=question.order,
            observed=question.observed,
        )
        try:
            return state.state_at(self._ctx, question.location, query)
        except NoModelError:
            return self._observed(question)

    def _observed(self, question: Question) -> ViewedState:
        location = locations.find_location(self._ctx, question.location)
        seen = observed_map(self._ctx, location, question.time)
        confidence = location.confidence if question.confidence is None else question.confidence
        return UnmodelledState(
            question.time, confidence, location.cells.shape, seen.cell, observed=seen.state, observed_time=seen.time
        )

    def first_update(self) -> int:
        """As the server's settings say."""
        return self._ctx.settings.update_samples

    def events(self, name: str, start: float) -> list[Anomaly]:
        """Anomalies since `start`."""
        return anomalies.list_events(self._ctx, anomalies.EventQuery(location=name, start=start, limit=MARKS))

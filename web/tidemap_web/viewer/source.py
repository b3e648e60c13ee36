"""What the viewer asks the services for; one small face, so that sessions can be tested without a database."""

from dataclasses import dataclass
from typing import Protocol

from tidemap.errors import LocationNotFoundError
from tidemap.scope import EVERYWHERE, Scope
from tidemap.services import anomalies, locations, state
from tidemap.services.anomalies import Anomaly
from tidemap.services.context import Context
from tidemap.services.locations import LocationSummary
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


class Source(Protocol):
    """Everything a session needs to know."""

    def now(self) -> float:
        """Unix seconds."""

    def grids(self) -> list[LocationSummary]:
        """All locations that are grids, by name."""

    def grid(self, name: str) -> LocationSummary:
        """One of them. Raises LocationNotFoundError."""

    def state(self, question: Question) -> ViewedState:
        """Raises NoModelError before the first revision."""

    def events(self, name: str, start: float) -> list[Anomaly]:
        """Anomalies since `start`, oldest first, at most MARKS."""


class Services:
    """The source over the services of a running server, for who may see the locations of a scope: others are none."""

    def __init__(self, ctx: Context, scope: Scope = EVERYWHERE) -> None:
        self._ctx = ctx
        self._scope = scope

    def now(self) -> float:
        """Unix seconds."""
        return self._ctx.clock()

    def grids(self) -> list[LocationSummary]:
        """All locations that are grids, by name."""
        found = locations.list_locations(self._ctx, scope=self._scope)
        return [location for location in found if location.grid is not None]

    def grid(self, name: str) -> LocationSummary:
        """One grid with what is known of it."""
        self._check(name)
        location = locations.get_location(self._ctx, name)
        if location.grid is None:
            raise LocationNotFoundError(name)
        return location

    def state(self, question: Question) -> ViewedState:
        """The state at a time."""
        self._check(question.location)
        query = state.StateQuery(
            time=question.time,
            confidence=question.confidence,
            order=question.order,
            observed=question.observed,
        )
        return state.state_at(self._ctx, question.location, query)

    def events(self, name: str, start: float) -> list[Anomaly]:
        """Anomalies since `start`."""
        self._check(name)
        return anomalies.list_events(self._ctx, anomalies.EventQuery(location=name, start=start, limit=MARKS))

    def _check(self, name: str) -> None:
        if not self._scope.holds(name):
            raise LocationNotFoundError(name)

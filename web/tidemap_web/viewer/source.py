"""What the viewer asks the services for; one small face, so that sessions can be tested without a database."""

from collections.abc import Hashable, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import LocationNotFoundError, NoModelError
from tidemap.scope import EVERYWHERE, Scope
from tidemap.services import anomalies, building, films, locations, map_view, robots
from tidemap.services.anomalies import Anomaly
from tidemap.services.building import PosedState
from tidemap.services.context import Context, Seen
from tidemap.services.films import Watch
from tidemap.services.locations import LocationSummary
from tidemap.services.map_view import MapQuery, MapView
from tidemap.services.robots import SensorTrack
from tidemap.services.spectra import Fitted, fitted

MARKS = 500


class Source(Protocol):
    """Everything a session needs to know."""

    def now(self) -> float:
        """Unix seconds."""

    def grids(self) -> list[LocationSummary]:
        """All locations that are grids, by name."""

    def grid(self, name: str) -> LocationSummary:
        """One of them. Raises LocationNotFoundError, also for a location that is no grid."""

    def is_location(self, name: str) -> bool:
        """Whether there is a location of this name, grid or not."""

    def view(self, query: MapQuery, like: MapView | None) -> MapView:
        """The map at a time, by the model of another view where there is one; before the first revision what was last
        seen, of revision 0 and without probabilities (NaN)."""

    def first_update(self) -> int:
        """Measurements of a location from which on it has its first update."""

    def window(self, query: MapQuery) -> Hashable:
        """Equal for questions whose `load` is the same work."""

    def load(self, query: MapQuery, watch: Watch) -> Seen | None:
        """What was last seen then, where a view has it not at hand. `watch` hears how far it is."""

    def events(self, name: str, start: float) -> list[Anomaly]:
        """Anomalies since `start`, oldest first, at most MARKS."""

    def day_amplitude(self, view: MapView) -> NDArray[np.float32]:
        """p's amplitude over the day of a view, (n_cells,); equal for views with the same `map_view.day_of`."""

    def posed(self, frame: str) -> list[Fitted]:
        """The states that stand in a frame, with what is known of them."""

    def posed_at(self, models: Sequence[Fitted], time: float) -> list[PosedState]:
        """They at a time."""

    def has_scans(self, location: LocationSummary) -> bool:
        """Whether any scan of a grid is listed."""

    def tracks(self, location: LocationSummary, start: float, stop: float) -> list[SensorTrack]:
        """Where the sensors of a grid have been in [start, stop]."""


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

    def is_location(self, name: str) -> bool:
        """Whether there is one."""
        if not self._scope.holds(name):
            return False
        try:
            locations.find_location(self._ctx, name)
        except LocationNotFoundError:
            return False
        return True

    def view(self, query: MapQuery, like: MapView | None) -> MapView:
        """The map at a time."""
        self._check(query.location)
        if like is not None and not like.loaded.revision.revision:
            like = None  # it knows of the cells that had been seen by its own time
        try:
            return map_view.map_at(self._ctx, query, like)
        except NoModelError:
            return map_view.observed_at(self._ctx, query)

    def first_update(self) -> int:
        """As the server's settings say."""
        return self._ctx.settings.update_samples

    def window(self, query: MapQuery) -> Hashable:
        """The film that it needs."""
        self._check(query.location)
        location = locations.find_location(self._ctx, query.location)
        return location.id, films.film_key(self._ctx, location, query.time)

    def load(self, query: MapQuery, watch: Watch) -> Seen | None:
        """What was last seen then, from the film that it needs."""
        self._check(query.location)
        return films.make_film(self._ctx, fitted(self._ctx, query.location), query.time, watch)

    def events(self, name: str, start: float) -> list[Anomaly]:
        """Anomalies since `start`."""
        self._check(name)
        return anomalies.list_events(self._ctx, anomalies.EventQuery(location=name, start=start, limit=MARKS))

    def day_amplitude(self, view: MapView) -> NDArray[np.float32]:
        """p's amplitude over the day of a view."""
        return map_view.day_amplitude_at(self._ctx, view)

    def posed(self, frame: str) -> list[Fitted]:
        """The states in scope that stand in a frame."""
        return building.posed_models(self._ctx, frame, self._scope)

    def posed_at(self, models: Sequence[Fitted], time: float) -> list[PosedState]:
        """They at a time."""
        return building.posed_at(self._ctx, models, time)

    def has_scans(self, location: LocationSummary) -> bool:
        """Whether any scan of a grid is listed."""
        return robots.has_scans(self._ctx, location.id)

    def tracks(self, location: LocationSummary, start: float, stop: float) -> list[SensorTrack]:
        """Where the sensors of a grid have been in [start, stop]."""
        return robots.sensor_tracks(self._ctx, location.id, start, stop)

    def _check(self, name: str) -> None:
        if not self._scope.holds(name):
            raise LocationNotFoundError(name)

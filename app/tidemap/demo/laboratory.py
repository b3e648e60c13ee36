"""The laboratory at the server: every area as a 3D map, as a 2D map and as whether a person was seen."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tidemap.client import Client
from tidemap.demo.areas import AREAS, Area
from tidemap.demo.locations import USUAL
from tidemap.demo.posting import SOURCE
from tidemap.demo.visits import Scanned, Visit, Visitor
from tidemap.schemas.locations import Grid, Location
from tidemap.space.grid import GridGeometry

MIN_CELLS, MIN_FLOOR_CELLS = 40, 8
"""Fewer surprising cells of a 3D or of a 2D map are no event: some of somebody who sits are."""


def camera_name(area: Area) -> str:
    """The location with the 3D map of an area."""
    return f"{area.name}-3d"


def laser_name(area: Area) -> str:
    """The location with its 2D map."""
    return f"{area.name}-2d"


def person_name(area: Area) -> str:
    """The location that says whether a person was seen."""
    return f"{area.name}-person"


def _form(kind: str, grid: GridGeometry, min_cells: int) -> dict[str, Any]:
    cells = Grid(frame=grid.frame, origin=grid.origin, resolution_m=grid.resolution_m, shape=list(grid.shape))
    return USUAL | {"kind": kind, "grid": cells, "min_cells": min_cells}


FORMS: dict[str, dict[str, Any]] = {
    name: form
    for area in AREAS
    for name, form in {
        camera_name(area): _form("grid3d", area.grid, MIN_CELLS),
        laser_name(area): _form("grid2d", area.floor_grid, MIN_FLOOR_CELLS),
        person_name(area): USUAL | {"kind": "state"},
    }.items()
}


@dataclass
class PostedVisits:
    """What came of posting: how many visits, and how many scans with each verdict of registration."""

    visits: int = 0
    verdicts: Counter[str] = field(default_factory=Counter)


class Laboratory:
    """Posts the visits of one robot in order of time; what a location has already it does not get again."""

    def __init__(self, client: Client, visitor: Visitor, known: Mapping[str, Location]) -> None:
        self._client, self._visitor = client, visitor
        self._last = {name: location.last_time or 0.0 for name, location in known.items()}
        self.posted = PostedVisits()

    def since(self) -> float:
        """All visits after this have something that is to be posted."""
        return min(self._last.values())

    def post(self, times: Sequence[float]) -> None:
        """Visit every area at each of some times, and post what was seen. Raises TidemapError."""
        for area in AREAS:
            last = min(self._last[name] for name in (camera_name(area), laser_name(area), person_name(area)))
            new = (self._visitor.visit(area, time) for time in times if time > last)
            visits = [visit for visit in new if visit is not None]
            for visit in visits:
                self._scan(camera_name(area), visit.time, visit.camera)
                self._scan(laser_name(area), visit.time, visit.laser)
            self._persons(person_name(area), visits)
            self.posted.visits += len(visits)

    def _scan(self, name: str, time: float, scanned: Scanned) -> None:
        if time <= self._last[name]:
            return
        answer = self._client.location(name).observe_scan(
            scanned.points[:, :2] if scanned.sensor.flat else scanned.points,
            scanned.stated.values,
            time,
            covariance=scanned.covariance,
            max_range=scanned.sensor.max_range_m,
            source=SOURCE,
            # A scan in quarantine is no observation, and would be posted again.
            idempotency_key=f"demo-{name}-{time:.0f}",
        )
        self._last[name] = time
        if answer.registration is not None:
            self.posted.verdicts[answer.registration.verdict] += 1

    def _persons(self, name: str, visits: Sequence[Visit]) -> None:
        new = [visit for visit in visits if visit.time > self._last[name]]
        if new:
            time = np.array([visit.time for visit in new])
            self._client.location(name).observe(time, np.array([visit.person for visit in new]), source=SOURCE)
            self._last[name] = new[-1].time

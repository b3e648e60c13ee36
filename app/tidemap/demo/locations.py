"""The locations of the demo at the server."""

import math
from collections.abc import Mapping
from typing import Any

from tidemap.client import Client, LocationHandle, TidemapError
from tidemap.demo.civil import ZONE
from tidemap.demo.plan import RESOLUTION_M, SHAPE
from tidemap.demo.robot import INTERVAL_S
from tidemap.schemas.locations import Grid, Location

BUILDING = "building"
POSITIONS = {
    "main-door": (0.1, 4.1, 2.7),
    "office-door": (5.7, 3.3, 2.7),
    "office-occupied": (3.5, 1.7, 2.7),
    "lab-occupied": (3.9, 6.3, 2.7),
    "meeting-room": (9.4, 1.7, 2.7),
}
"""Where doors and rooms stand in the building, in metres: above their walls, so that they are seen."""
LOCATIONS = tuple(POSITIONS)
CONFLICT = 409
MIN_CELLS = 4
NO_EVENTS = math.prod(SHAPE)
"""As min_cells while the history is filled in: what a model of its first days calls abnormal is no event."""

USUAL: dict[str, Any] = {"interval_s": INTERVAL_S, "time_zone": ZONE, "epoch": 0.0}
"""Of all locations."""
FORMS: dict[str, dict[str, Any]] = {
    BUILDING: USUAL
    | {
        "kind": "grid3d",
        "grid": Grid(frame="map", origin=(0.0, 0.0, 0.0), resolution_m=RESOLUTION_M, shape=list(SHAPE)),
        "confidence": 0.97,
        "min_cells": NO_EVENTS,
    }
} | {
    name: USUAL | {"kind": "state", "confidence": 0.95, "pose": {"frame": "map", "position": position}}
    for name, position in POSITIONS.items()
}
_FIXED = ("kind", "interval_s", "epoch", "grid")


class NotTheDemoError(TidemapError):
    """A location of the demo's name is somebody else's: other cells or another time base."""

    def __init__(self, name: str) -> None:
        super().__init__(
            CONFLICT,
            "Name taken",
            f"There is a location {name!r} already, and it is not the demo's: rename or delete it, "
            "or run the demo on a server of its own (--data DIR).",
        )


def prepare(client: Client, forms: Mapping[str, Mapping[str, Any]] = FORMS) -> dict[str, Location]:
    """The locations of some forms with what is known of them, made where they are missing.

    Raises NotTheDemoError before anything is made if a name is taken by something else.
    """
    known = {location.name: location for location in client.locations()}
    for name in known.keys() & forms.keys():
        check(known[name], forms[name])
    for name in forms.keys() - known.keys():
        known[name] = create(client, name, forms[name]).get()
    return {name: known[name] for name in forms}


def begin_events(client: Client) -> None:
    """From now on MIN_CELLS surprising cells of the building are an event."""
    building = client.location(BUILDING)
    if building.get().min_cells == NO_EVENTS:
        building.patch(min_cells=MIN_CELLS)


def create(client: Client, name: str, form: Mapping[str, Any]) -> LocationHandle:
    """Make one location, or take the one that somebody has made in the meantime."""
    try:
        return client.create_location(name, **form)
    except TidemapError as error:
        if error.status != CONFLICT:
            raise
    check(client.location(name).get(), form)
    return client.location(name)


def check(location: Location, form: Mapping[str, Any]) -> None:
    """Raises NotTheDemoError for a location whose cells or time base are not those of its form."""
    if any(getattr(location, field) != form.get(field) for field in _FIXED):
        raise NotTheDemoError(location.name)

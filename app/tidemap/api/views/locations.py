"""Locations as the API takes and shows them."""

from dataclasses import asdict
from typing import Any, cast

from tidemap.errors import InvalidInputError
from tidemap.schemas.locations import Grid, Location, LocationForm, LocationPatch, Position
from tidemap.services.locations import LocationChanges, LocationSummary, NewLocation
from tidemap.space.grid import GridGeometry
from tidemap.space.pose import FramedPosition


def location_view(known: LocationSummary) -> Location:
    """A location with what is known of it."""
    named = {name: getattr(known, name) for name in Location.model_fields if hasattr(known, name)}
    own = {
        "grid": None if known.grid is None else _grid(known.grid),
        "shape": list(known.cells.shape),
        "order": known.order or "auto",
        "pose": None if known.pose is None else Position(**asdict(known.pose)),
        "retention": known.retention_s,
    }
    return Location(**(named | own))


def new_location(form: LocationForm) -> NewLocation:
    """What a location is made with."""
    return NewLocation(
        **_named(form.model_dump(exclude={"grid"})), grid=None if form.grid is None else _geometry(form.grid)
    )


def location_changes(form: LocationPatch) -> LocationChanges:
    """What a form changes. Raises InvalidInputError."""
    values = form.model_dump(exclude_unset=True)
    for field, value in values.items():
        if value is None and field not in ("hold_s", "retention", "calendar", "pose"):
            raise InvalidInputError.at(field, "null is no value here; leave the field out to keep it as it is")
    return cast(LocationChanges, _named(values))


def _named(values: dict[str, Any]) -> dict[str, Any]:
    """Settings with the names and values of records."""
    own = {"order": None if values["order"] == "auto" else values["order"]} if "order" in values else {}
    if "retention" in values:
        own["retention_s"] = values.pop("retention")
    if values.get("pose") is not None:
        own["pose"] = FramedPosition(**values["pose"])
    return values | own


def _geometry(grid: Grid) -> GridGeometry:
    return GridGeometry(grid.frame, grid.origin, grid.resolution_m, tuple(grid.shape))


def _grid(grid: GridGeometry) -> Grid:
    return Grid(**{**asdict(grid), "shape": list(grid.shape)})

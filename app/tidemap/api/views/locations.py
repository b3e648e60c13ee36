"""Locations as the API shows them."""

from dataclasses import asdict

from tidemap.schemas.locations import Grid, Location
from tidemap.services.locations import LocationSummary
from tidemap.space.grid import GridGeometry
from tidemap.spectral.sensor import Sensor


def location_view(known: LocationSummary) -> Location:
    """A location with what is known of it."""
    named = {name: getattr(known, name) for name in Location.model_fields if hasattr(known, name)}
    own = {
        "grid": None if known.grid is None else _grid(known.grid),
        "shape": list(known.cells.shape),
        "order": known.order or "auto",
        "retention": known.retention_s,
        "sensor": asdict(known.sensor) if isinstance(known.sensor, Sensor) else known.sensor,
    }
    return Location(**(named | own))


def _grid(grid: GridGeometry) -> Grid:
    return Grid(**{**asdict(grid), "shape": list(grid.shape)})

"""A body to measurements, as a post is read for a location."""

from dataclasses import dataclass

from tidemap.formats import registry
from tidemap.formats.registry import Body
from tidemap.history.measurements import Measurements
from tidemap.ingest import observation
from tidemap.space.grid import GridGeometry


@dataclass(frozen=True, slots=True)
class Target:
    """The location's grid, and the latest and earliest time that measurements may have."""

    grid: GridGeometry
    latest: float
    earliest: float = -6e10


def parse(body: Body, target: Target) -> Measurements:
    """The measurements of a body, in order."""
    columns = registry.read(body, target.grid)
    return observation.checked(columns, observation.Target(target.grid, target.earliest, target.latest))

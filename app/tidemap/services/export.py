"""Export: the map at a moment as a file, as predicted or as last observed."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tidemap.errors import InvalidInputError
from tidemap.formats.map_files import FORMATS, MapContent, MapFormat
from tidemap.history.history import OCCUPIED
from tidemap.services.context import Context
from tidemap.services.given import Given
from tidemap.services.locations import find_location
from tidemap.services.observed_map import observed_map
from tidemap.services.parts import refuse_large
from tidemap.services.state import StateQuery, state_at
from tidemap.space.map_cells import MapCells
from tidemap.storage.records import LocationRecord

Check = Callable[[], None]


@dataclass(frozen=True, slots=True)
class ExportQuery:
    """The map at a time (Unix seconds) in a format of `FORMATS`; z_min, z_max: the height band in metres.

    confidence: None for the location's. given: as `StateQuery`, of a predicted map.
    """

    format: str
    time: float
    mode: Literal["trinary", "scale"] = "trinary"
    source: Literal["predicted", "observed"] = "predicted"
    confidence: float | None = None
    given: Given = "observations"
    z_min: float | None = None
    z_max: float | None = None


@dataclass(frozen=True, slots=True)
class ExportedMap:
    """A file with its name. unavailable: ranges [first, stop) of cells whose blobs are damaged; they look unknown."""

    name: str
    media_type: str
    content: bytes
    time: float
    revision: int
    unavailable: list[tuple[int, int]]


@dataclass(frozen=True, slots=True, eq=False)
class _Snapshot:
    """The map at a time, and the revision that says so."""

    cells: MapCells
    revision: int
    unavailable: list[tuple[int, int]]


def export_map(ctx: Context, name: str, query: ExportQuery, check: Check) -> ExportedMap:
    """The map at a time as a file.

    Raises LocationNotFoundError, InvalidInputError, CorruptChunkError; NoModelError for a predicted map alone.
    """
    location, chosen = find_location(ctx, name), FORMATS[query.format, query.mode]
    refuse_large(ctx, location)
    _check_fits(location, query, chosen)
    snapshot = (
        _observed(ctx, location, query, check) if query.source == "observed" else _predicted(ctx, location, query)
    )
    check()
    cells = _cut(snapshot.cells, query, chosen)
    facts = {"location": name, "time": query.time, "source": query.source, "revision": snapshot.revision}
    try:
        content = chosen.write(MapContent(cells, facts))
    except ValueError as error:
        raise InvalidInputError.at("format", str(error)) from None
    file = f"{name}.{chosen.suffix}"
    return ExportedMap(file, chosen.media_type, content, query.time, snapshot.revision, snapshot.unavailable)


def _check_fits(location: LocationRecord, query: ExportQuery, chosen: MapFormat) -> None:
    """Raises InvalidInputError for what no map of this location can be."""
    if location.grid is None and chosen.spatial:
        raise InvalidInputError.at("format", "a location of kind 'state' has no extent; ask for npz or arrow")
    for field, value in (("z_min", query.z_min), ("z_max", query.z_max)):
        if value is not None and location.cells.shape3[2] == 1:
            raise InvalidInputError.at(field, "this location has one layer; leave it out")
    if query.z_min is not None and query.z_max is not None and query.z_min > query.z_max:
        raise InvalidInputError.at("z_max", "it is below z_min; swap them")


def _predicted(ctx: Context, location: LocationRecord, query: ExportQuery) -> _Snapshot:
    view = state_at(ctx, location.name, StateQuery(query.time, query.confidence, given=query.given))
    cells = MapCells(location.cells, view.cell, view.probability, view.verdict)
    return _Snapshot(cells, view.revision, view.unavailable)


def _observed(ctx: Context, location: LocationRecord, query: ExportQuery, check: Check) -> _Snapshot:
    """What was seen last of each cell at that time."""
    seen = observed_map(ctx, location, query.time, check)
    probability = (seen.state == OCCUPIED).astype(np.float32)
    return _Snapshot(MapCells(location.cells, seen.cell, probability, seen.state), location.revision, seen.unavailable)


def _cut(cells: MapCells, query: ExportQuery, chosen: MapFormat) -> MapCells:
    """The height band, as one layer where the format has no more."""
    if query.z_min is not None or query.z_max is not None:
        try:
            cells = cells.band(query.z_min, query.z_max)
        except ValueError as error:
            raise InvalidInputError.at("z_min" if query.z_min is not None else "z_max", str(error)) from None
    return cells.flattened() if chosen.flat and cells.grid.shape3[2] > 1 else cells

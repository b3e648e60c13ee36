"""What a request asks of a board: how cells are drawn, which are cut away, and how old a sighting may be."""

from typing import Final

from tidemap.storage.records import LocationRecord
from tidemap_web.viewer.board import Crop, Taste
from tidemap_web.viewer.messages import MAX_STEPS, ViewRequest

FRESH_S: Final = 3600.0


def fresh_s_of(location: LocationRecord) -> float:
    """Up to how old sightings of a location are judged: an hour, or two samples."""
    return max(FRESH_S, 2 * location.interval_s)


def taste_of(request: ViewRequest, location: LocationRecord) -> Taste:
    """As the page wants it."""
    return Taste(
        floor=request.floor,
        fresh_s=fresh_s_of(location),
        dim=request.dim,
        crop=_crop(request),
        layout=request.layout,
        predicted=request.predicted,
        observed=request.observed,
    )


def _crop(request: ViewRequest) -> Crop:
    i0, i1, j0, j1 = request.crop or (0, MAX_STEPS, 0, MAX_STEPS)
    low, high = 0 if request.low is None else request.low, MAX_STEPS if request.high is None else request.high
    return i0, j0, low, i1, j1, high

"""Map view: a whole map at one time as it is drawn, in arrays over all cells that are shared and not copied."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tidemap.services.context import Context, Loaded, Seen
from tidemap.services.films import seen_at
from tidemap.services.spectra import Fitted, fitted
from tidemap.spectral.prediction import predict, probability
from tidemap.storage.records import LocationRecord


@dataclass(frozen=True, slots=True)
class MapQuery:
    """A question for one time (Unix seconds); None stands for the location's own choice."""

    location: str
    time: float
    confidence: float | None = None
    order: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class MapView:
    """probability (n_cells,) float32 of the model at `time`, NaN where never observed.

    seen: what was last seen by then; None where it is not at hand, see `films.make_film`.
    """

    location: LocationRecord
    loaded: Loaded
    time: float
    confidence: float
    probability: NDArray[np.float32]
    seen: Seen | None


def map_at(ctx: Context, query: MapQuery, like: MapView | None = None) -> MapView:
    """The map at a time, by the model of `like` where that is given: nothing is asked of the database then.

    Raises LocationNotFoundError, NoModelError, CorruptChunkError.
    """
    model = fitted(ctx, query.location, None, query.order) if like is None else Fitted(like.location, like.loaded)
    location = model.location
    confidence = location.confidence if query.confidence is None else query.confidence
    predicted = predict(model.spectrum, query.time, threads=ctx.settings.update_threads)
    return MapView(location, model.loaded, query.time, confidence, predicted, seen_at(ctx, location, query.time))


def usual(loaded: Loaded) -> NDArray[np.float32]:
    """(n_cells,) the probability without any rhythm, NaN where never observed."""
    return probability(loaded.spectrum, loaded.spectrum.mean.copy())

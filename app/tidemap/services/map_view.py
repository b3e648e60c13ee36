"""Map view: a whole map at one time as it is drawn, in arrays over all cells that are shared and not copied."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tidemap.history.history import NEVER, UNOBSERVED
from tidemap.services.context import Context, Loaded, Seen
from tidemap.services.films import seen_at
from tidemap.services.locations import find_location
from tidemap.services.observed_map import observed_map
from tidemap.services.parts import refuse_large
from tidemap.services.spectra import Fitted, fitted
from tidemap.settings import DAY_S
from tidemap.spectral.civil import civil_seconds
from tidemap.spectral.daily import day_amplitude
from tidemap.spectral.prediction import predict, probability
from tidemap.spectral.recipe import Recipe
from tidemap.spectral.spectrum import Spectrum
from tidemap.storage.records import LocationRecord, RevisionRecord


@dataclass(frozen=True, slots=True)
class MapQuery:
    """A question for one time (Unix seconds); None stands for the location's own choice."""

    location: str
    time: float
    confidence: float | None = None
    order: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class MapView:
    """probability (n_cells,) float32 of the model at `time`, NaN where never observed, and before there is a model.

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


def day_of(view: MapView) -> float:
    """When the local day of a view began, Unix seconds."""
    return view.time - float(civil_seconds(np.array(view.time), view.location.time_zone) % DAY_S)


def day_amplitude_at(ctx: Context, view: MapView) -> NDArray[np.float32]:
    """The amplitude of p over the local day of a view, (n_cells,), NaN where never observed: 24 predictions."""
    return day_amplitude(view.loaded.spectrum, day_of(view), threads=ctx.settings.update_threads)


def observed_at(ctx: Context, query: MapQuery) -> MapView:
    """What was last seen at a time before there is a model: of revision 0, and no probability is known.

    Raises LocationNotFoundError.
    """
    location = find_location(ctx, query.location)
    refuse_large(ctx, location)
    found = observed_map(ctx, location, query.time)
    seen = Seen(np.full(location.n_cells, UNOBSERVED, np.uint8), np.full(location.n_cells, NEVER, np.int64))
    seen.state[found.cell], seen.sample[found.cell] = found.state, location.base.sample(found.time)
    confidence = location.confidence if query.confidence is None else query.confidence
    unknown = np.full(location.n_cells, np.nan, np.float32)
    return MapView(location, unmodelled(location, found.cell), query.time, confidence, unknown, seen)


def unmodelled(location: LocationRecord, cell: NDArray[np.int64]) -> Loaded:
    """As a model that knows of some cells that they were observed, and nothing more."""
    mean = np.full(location.n_cells, np.nan, np.float32)
    mean[cell] = 0
    spectrum = Spectrum(
        "identity",
        0.0,
        None,
        frequency_hz=np.zeros(0),
        gate=np.zeros(0, np.uint8),
        mean=mean,
        cell=np.zeros(0, np.int32),
        index=np.zeros((0, 0), np.uint16),
        coefficient=np.zeros((0, 0), np.complex64),
        base=location.base,
    )
    revision = RevisionRecord(
        location_id=location.id,
        revision=0,
        recipe=Recipe("static", 0, location.time_zone),
        start=0,
        stop=0,
        observation_seq=location.observation_seq,
        measurements=location.measurements,
        accuracy=None,
        updated_at=0.0,
        selection=None,
    )
    return Loaded(revision, spectrum, {})


def usual(loaded: Loaded) -> NDArray[np.float32]:
    """(n_cells,) the probability without any rhythm, NaN where never observed."""
    return probability(loaded.spectrum, loaded.spectrum.mean.copy())

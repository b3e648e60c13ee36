"""Questions about the state at any time (Eq. 3)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.errors import CellNotFoundError, InvalidInputError, refuse_reversed
from app.services.context import Context
from app.services.history import last_seen, read_cell, window
from app.services.spectra import Fitted, fitted
from app.spectral.history import NEVER, UNOBSERVED
from app.spectral.prediction import entropy, predict, predict_times, state, verdict
from app.storage.records import LocationRecord


@dataclass(frozen=True, slots=True)
class StateQuery:
    """A question for one time (Unix seconds). `bbox` is [x0,y0,z0,x1,y1,z1] in metres; None: the location's own."""

    time: float
    confidence: float | None = None
    order: int | None = None
    estimator: str | None = None
    bbox: tuple[float, ...] | None = None
    observed: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class StateView:
    """The cells that have been observed, (n,) each.

    verdict: 0 free, 1 occupied, 2 uncertain. observed: as last seen at that time, 2 where never before;
    observed_time: start of that sample, NaN where never before. Both None unless asked for.
    unavailable: ranges [first, stop) of cells whose blobs are damaged: these are left out, or lack what was last seen.
    """

    location_id: int
    time: float
    confidence: float
    estimator: str
    order: int
    revision: int
    shape: tuple[int, ...]
    cell: NDArray[np.int64]
    probability: NDArray[np.float32]
    state: NDArray[np.uint8]
    verdict: NDArray[np.uint8]
    observed: NDArray[np.uint8] | None
    observed_time: NDArray[np.float64] | None
    unavailable: list[tuple[int, int]]

    @property
    def n_cells(self) -> int:
        """Number of cells of the whole location."""
        return int(np.prod(self.shape, dtype=np.int64))


def state_at(ctx: Context, name: str, query: StateQuery) -> StateView:
    """The state at a time. Raises LocationNotFoundError, NoModelError, InvalidInputError."""
    model = fitted(ctx, name, query.estimator, query.order)
    place = model.place
    probability = predict(model.spectrum, query.time, threads=ctx.settings.update_threads)
    cell = np.flatnonzero(~np.isnan(probability))
    if query.bbox is not None:
        cell = cell[_box(place, query.bbox, cell)]
    probability = probability[cell]
    confidence = place.confidence if query.confidence is None else query.confidence
    seen = last_seen(ctx, place, int(place.base.sample(query.time)), cell) if query.observed else None
    return StateView(
        location_id=place.id,
        time=query.time,
        confidence=confidence,
        estimator=model.revision.estimator,
        order=model.revision.order,
        revision=model.revision.revision,
        shape=place.cells.shape,
        cell=cell,
        probability=probability,
        state=state(probability, confidence),
        verdict=verdict(probability, confidence),
        observed=None if seen is None else seen.state,
        observed_time=None if seen is None else _start(place, seen.sample),
        unavailable=place.cell_ranges({*model.damage, *(() if seen is None else seen.damaged)}),
    )


def _box(place: LocationRecord, bbox: tuple[float, ...], cell: NDArray[np.int64]) -> NDArray[np.bool_]:
    if place.grid is None:
        raise InvalidInputError.at("bbox", "a location of kind 'state' has no extent; leave bbox out")
    return place.grid.inside(bbox, cell)


def _start(place: LocationRecord, sample: NDArray[np.int64]) -> NDArray[np.float64]:
    """The times of samples, NaN for NEVER."""
    return np.where(sample == NEVER, np.nan, place.base.time(np.where(sample == NEVER, 0, sample)))


@dataclass(frozen=True, slots=True, eq=False)
class PredictionView:
    """time (n_t,), cell (n_c,); probability, state and entropy (n_c, n_t), NaN and 2 where never observed.

    unavailable: ranges [first, stop) of cells whose spectrum is damaged: they look as if never observed.
    """

    time: NDArray[np.float64]
    cell: NDArray[np.int64]
    confidence: float
    probability: NDArray[np.float32]
    state: NDArray[np.uint8]
    entropy: NDArray[np.float64]
    revision: int
    unavailable: list[tuple[int, int]]


@dataclass(frozen=True, slots=True)
class PredictQuery:
    """A question for many times; `cell` None asks for all cells."""

    time: list[float]
    cell: list[int] | None = None
    confidence: float | None = None
    order: int | None = None
    estimator: str | None = None


def predict_at(ctx: Context, name: str, query: PredictQuery) -> PredictionView:
    """Of all cells those that are unavailable look as if never observed; to name one of them is an error.

    Raises LocationNotFoundError, NoModelError, CellNotFoundError, CorruptChunkError, InvalidInputError when it asks for
    too much.
    """
    model = fitted(ctx, name, query.estimator, query.order)
    cell = _cells(model, query.cell)
    n_points = len(cell) * len(query.time)
    if n_points > ctx.settings.max_points:
        raise InvalidInputError.at(
            "time", f"{n_points} values are more than {ctx.settings.max_points}; ask for fewer times or cells"
        )
    confidence = model.place.confidence if query.confidence is None else query.confidence
    time = np.asarray(query.time, np.float64)
    probability = predict_times(model.spectrum, time, cell)
    return PredictionView(
        time,
        cell,
        confidence,
        probability,
        _state_or_unknown(probability, confidence),
        entropy(probability),
        model.revision.revision,
        model.unavailable,
    )


def _cells(model: Fitted, cells: list[int] | None) -> NDArray[np.int64]:
    n_cells = model.place.n_cells
    if cells is None:
        return np.arange(n_cells)
    for cell in cells:
        check_cell(model.place, cell)
    model.check_readable(cells)
    return np.asarray(cells, np.int64)


def check_cell(place: LocationRecord, cell: int) -> None:
    """Raises CellNotFoundError."""
    if not 0 <= cell < place.n_cells:
        raise CellNotFoundError(cell, place.n_cells)


def _state_or_unknown(probability: NDArray[np.float32], confidence: float) -> NDArray[np.uint8]:
    return np.where(np.isnan(probability), np.uint8(UNOBSERVED), state(probability, confidence))


@dataclass(frozen=True, slots=True, eq=False)
class SeriesView:
    """One cell over time, (n,) each; state and observed are 2 where unknown, observed is that of the time's sample."""

    cell: int
    time: NDArray[np.float64]
    probability: NDArray[np.float32]
    state: NDArray[np.uint8]
    observed: NDArray[np.uint8]
    revision: int


def series(
    ctx: Context,
    name: str,
    cell: int = 0,
    start: float | None = None,
    stop: float | None = None,
    step: float | None = None,
) -> SeriesView:
    """One cell over [start, stop), by default all of its history at every sample.

    Without a model the probability is NaN and the revision 0. Raises LocationNotFoundError, CellNotFoundError,
    CorruptChunkError, InvalidInputError.
    """
    with ctx.store.read() as work:
        place = work.locations.get(name)
    check_cell(place, cell)
    first, last = window(ctx, place)
    start = float(place.base.time(first)) if start is None else start
    stop = float(place.base.time(last)) if stop is None else stop
    time = _times(ctx, start, stop, place.interval_s if step is None else step)
    probability = np.full(len(time), np.nan, np.float32)
    revision = 0
    if place.revision:
        model = fitted(ctx, name)
        model.check_readable([cell])
        probability, revision = (
            predict_times(model.spectrum, time, np.array([cell]))[0],
            model.revision.revision,
        )
    observed = _observed_at(ctx, place, cell, time)
    return SeriesView(cell, time, probability, _state_or_unknown(probability, place.confidence), observed, revision)


def _times(ctx: Context, start: float, stop: float, step: float) -> NDArray[np.float64]:
    if not step > 0:
        raise InvalidInputError.at("step", "give a positive number of seconds")
    refuse_reversed(start, stop)
    most = ctx.settings.max_points
    if stop - start > most * step:
        raise InvalidInputError.at("step", f"these are more than {most} times; use a longer step or a shorter range")
    return np.asarray(start + step * np.arange(int(np.ceil((stop - start) / step))), np.float64)


def _observed_at(ctx: Context, place: LocationRecord, cell: int, time: NDArray[np.float64]) -> NDArray[np.uint8]:
    first, last = window(ctx, place)
    sample = place.base.sample(time)
    inside = (sample >= first) & (sample < last)
    observed = np.full(len(time), UNOBSERVED, np.uint8)
    if inside.any():
        low, high = int(sample[inside].min()), int(sample[inside].max()) + 1
        states = read_cell(ctx, place, cell, low, high).states()[0]
        observed[inside] = states[sample[inside] - low]
    return observed

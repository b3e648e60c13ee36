"""Questions about the state at any time (Eq. 3)."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from weakref import ref

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import CellNotFoundError, InvalidInputError
from tidemap.history.history import NEVER, UNOBSERVED
from tidemap.services.buffer_pool import BufferLease
from tidemap.services.context import Context
from tidemap.services.history import last_seen
from tidemap.services.keys import Claim
from tidemap.services.spectra import Fitted, fitted
from tidemap.services.state_buffer import StateBuffer
from tidemap.spectral.prediction import entropy, known, predict, predict_times, state, verdict
from tidemap.spectral.spectrum import Spectrum
from tidemap.storage.records import LocationRecord

BLOCK_VALUES = 1 << 16
"""Probabilities between two looks whether anybody still waits for them."""


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
class StateFacts:
    """What an answer says of itself.

    unavailable: ranges [first, stop) of cells whose blobs are damaged: these are left out, or lack what was last seen.
    """

    location_id: int
    time: float
    confidence: float
    estimator: str
    order: int
    revision: int
    shape: tuple[int, ...]
    unavailable: list[tuple[int, int]]

    @property
    def n_cells(self) -> int:
        """Number of cells of the whole location."""
        return int(np.prod(self.shape, dtype=np.int64))


@dataclass(frozen=True, slots=True, eq=False)
class StateView(StateFacts):
    """The cells that have been observed, (n,) each.

    verdict: 0 free, 1 occupied, 2 uncertain. observed: as last seen at that time, 2 where never before;
    observed_time: start of that sample, NaN where never before. Both None unless asked for.
    """

    cell: NDArray[np.int64]
    probability: NDArray[np.float32]
    state: NDArray[np.uint8]
    verdict: NDArray[np.uint8]
    observed: NDArray[np.uint8] | None
    observed_time: NDArray[np.float64] | None


@dataclass(frozen=True, slots=True, eq=False)
class Asked:
    """A question, and the spectrum that answers it."""

    query: StateQuery
    model: Fitted

    @property
    def confidence(self) -> float:
        """The question's, or the location's."""
        return self.model.location.confidence if self.query.confidence is None else self.query.confidence

    def facts(self) -> StateFacts:
        """What the answer says of itself, as far as it does not say what was last seen."""
        location, revision = self.model.location, self.model.revision
        return StateFacts(
            location_id=location.id,
            time=self.query.time,
            confidence=self.confidence,
            estimator=revision.estimator,
            order=revision.order,
            revision=revision.revision,
            shape=location.cells.shape,
            unavailable=self.model.unavailable,
        )


def ask(ctx: Context, name: str, query: StateQuery, claim: Claim | None = None) -> Asked:
    """What answers a question; nothing is computed yet.

    Raises LocationNotFoundError, NoModelError, CorruptChunkError, UnauthorizedError.
    """
    return Asked(query, fitted(ctx, name, query.estimator, query.order, claim))


def state_at(ctx: Context, name: str, query: StateQuery) -> StateView:
    """The state at a time. Raises LocationNotFoundError, NoModelError, InvalidInputError."""
    return view_of(ctx, ask(ctx, name, query))


def view_of(ctx: Context, asked: Asked) -> StateView:
    """The answer in arrays. Raises InvalidInputError."""
    query, model, location = asked.query, asked.model, asked.model.location
    cell, probability = _asked_for(ctx, asked)
    seen = last_seen(ctx, location, int(location.base.sample(query.time)), cell) if query.observed else None
    facts = asked.facts()
    damaged = {*model.damage, *(() if seen is None else seen.damaged)}
    return StateView(
        **{each.name: getattr(facts, each.name) for each in fields(facts) if each.name != "unavailable"},
        unavailable=location.cell_ranges(damaged),
        cell=cell,
        probability=probability,
        state=state(probability, asked.confidence),
        verdict=verdict(probability, asked.confidence),
        observed=None if seen is None else seen.state,
        observed_time=None if seen is None else _start(location, seen.sample),
    )


def buffer_of(ctx: Context, asked: Asked) -> BufferLease[StateBuffer] | None:
    """The answer as it is sent in Arrow; None where it is not about a whole map."""
    spectrum, confidence = asked.model.spectrum, asked.confidence
    if asked.query.bbox is not None or asked.query.observed:
        return None
    key = (asked.model.location.id, asked.model.revision.recipe, confidence)
    lease = ctx.buffers.lease(key, ref(asked.model.loaded), lambda: StateBuffer.of(spectrum, confidence))
    lease.value.write(spectrum, asked.query.time, ctx.settings.update_threads)
    return lease


def grid_of(ctx: Context, asked: Asked) -> NDArray[np.float32]:
    """The probability of all cells, in the location's shape; NaN where never observed or outside of the box."""
    shape, spectrum = asked.model.location.cells.shape, asked.model.spectrum
    if asked.query.bbox is None:
        return predict(spectrum, asked.query.time, threads=ctx.settings.update_threads).reshape(shape)
    grid = np.full(spectrum.n_cells, np.nan, np.float32)
    cell, probability = _asked_for(ctx, asked)
    grid[cell] = probability
    return grid.reshape(shape)


def _asked_for(ctx: Context, asked: Asked) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """The cells that have been observed, of those in the box if there is one, and their probability."""
    spectrum, query = asked.model.spectrum, asked.query
    if query.bbox is None:
        return _known(predict(spectrum, query.time, threads=ctx.settings.update_threads))
    cell = known(spectrum)
    cell = cell[_box(asked.model.location, query.bbox, cell)]
    return cell, predict(spectrum, query.time, cell)


def _known(probability: NDArray[np.float32]) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """The cells that have been observed, and their probability."""
    missing = np.isnan(probability)
    if not missing.any():
        return np.arange(len(probability)), probability
    cell = np.flatnonzero(~missing)
    return cell, probability[cell]


def _box(location: LocationRecord, bbox: tuple[float, ...], cell: NDArray[np.int64]) -> NDArray[np.bool_]:
    if location.grid is None:
        raise InvalidInputError.at("bbox", "a location of kind 'state' has no extent; leave bbox out")
    return location.grid.inside(bbox, cell)


def _start(location: LocationRecord, sample: NDArray[np.int64]) -> NDArray[np.float64]:
    """The times of samples, NaN for NEVER."""
    return np.where(sample == NEVER, np.nan, location.base.time(np.where(sample == NEVER, 0, sample)))


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


def predict_at(
    ctx: Context, name: str, query: PredictQuery, check: Callable[[], None] = lambda: None
) -> PredictionView:
    """`check` is called between blocks; what it raises ends this.

    Of all cells those that are unavailable look as if never observed; to name one of them is an error.

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
    confidence = model.location.confidence if query.confidence is None else query.confidence
    time = np.asarray(query.time, np.float64)
    probability = predict_in_blocks(model.spectrum, time, cell, check)
    return PredictionView(
        time,
        cell,
        confidence,
        probability,
        state_or_unknown(probability, confidence),
        entropy(probability),
        model.revision.revision,
        model.unavailable,
    )


def predict_in_blocks(
    spectrum: Spectrum, time: NDArray[np.float64], cells: NDArray[np.int64], check: Callable[[], None]
) -> NDArray[np.float32]:
    """As `predict_times`, (n_cells, n_times), with `check` called before every block of times."""
    out = np.empty((len(cells), len(time)), np.float32)
    step = max(1, BLOCK_VALUES // max(1, len(cells)))
    for first in range(0, len(time), step):
        check()
        out[:, first : first + step] = predict_times(spectrum, time[first : first + step], cells)
    return out


def _cells(model: Fitted, cells: list[int] | None) -> NDArray[np.int64]:
    n_cells = model.location.n_cells
    if cells is None:
        return np.arange(n_cells)
    for cell in cells:
        check_cell(model.location, cell)
    model.check_readable(cells)
    return np.asarray(cells, np.int64)


def check_cell(location: LocationRecord, cell: int) -> None:
    """Raises CellNotFoundError."""
    if not 0 <= cell < location.n_cells:
        raise CellNotFoundError(cell, location.n_cells)


def state_or_unknown(probability: NDArray[np.float32], confidence: float) -> NDArray[np.uint8]:
    """The state, UNOBSERVED where p is NaN."""
    return np.where(np.isnan(probability), np.uint8(UNOBSERVED), state(probability, confidence))

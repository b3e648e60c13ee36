"""Questions about the state of a whole map at one time (Eq. 3)."""

from collections.abc import Collection
from dataclasses import dataclass, fields
from weakref import ref

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import InvalidInputError
from tidemap.formats.table import Column
from tidemap.history.history import NEVER
from tidemap.services.beliefs import detector_of
from tidemap.services.buffer_pool import BufferLease
from tidemap.services.context import Context
from tidemap.services.given import Given, Known, known_at
from tidemap.services.keys import Claim
from tidemap.services.observed import MapSeen, map_seen, observed_at
from tidemap.services.parts import in_box, refuse_large
from tidemap.services.spectra import Fitted, fitted
from tidemap.services.state_buffer import NOTHING, StateBuffer, seen_columns
from tidemap.space.grid import GridGeometry
from tidemap.spectral.prediction import predict, state, verdict
from tidemap.storage.records import LocationRecord


@dataclass(frozen=True, slots=True)
class StateQuery:
    """A question for one time (Unix seconds). `bbox` is [x0,y0,z0,x1,y1,z1] in metres; None: the location's own.

    given: what the answer is conditioned on: the readings at or before `as_of` (None: now), or the model alone.
    """

    time: float
    confidence: float | None = None
    order: int | None = None
    estimator: str | None = None
    bbox: tuple[float, ...] | None = None
    observed: bool = False
    as_of: float | None = None
    given: Given = "model"
    last_seen: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class StateFacts:
    """What an answer says of itself.

    unavailable: ranges [first, stop) of cells whose blobs are damaged: these are left out, or lack what was last seen.
    """

    location_id: int
    time: float
    as_of: float
    given: Given
    confidence: float
    estimator: str
    order: int
    revision: int
    shape: tuple[int, ...]
    grid: GridGeometry | None
    unavailable: list[tuple[int, int]]

    @property
    def n_cells(self) -> int:
        """Number of cells of the whole location."""
        return int(np.prod(self.shape, dtype=np.int64))


@dataclass(frozen=True, slots=True, eq=False)
class StateView(StateFacts):
    """The cells that have been observed, (n,) each.

    verdict: 0 free, 1 occupied, 2 uncertain. observed: as last seen at that time, 2 where never before;
    observed_time: start of that sample, NaN where never before. last_seen: start of the sample of the latest reading at
    or before `as_of`, NaN where there is none. None unless asked for.
    """

    cell: NDArray[np.int64]
    probability: NDArray[np.float32]
    state: NDArray[np.uint8]
    verdict: NDArray[np.uint8]
    observed: NDArray[np.uint8] | None
    observed_time: NDArray[np.float64] | None
    last_seen: NDArray[np.float64] | None


@dataclass(frozen=True, slots=True, eq=False)
class Asked:
    """A question, the spectrum that answers it, and when it was asked."""

    query: StateQuery
    model: Fitted
    as_of: float
    now: float

    @property
    def confidence(self) -> float:
        """The question's, or the location's."""
        return self.model.location.confidence if self.query.confidence is None else self.query.confidence

    @property
    def conditioned(self) -> bool:
        """Whether the answer may differ from the model's p: no reading says anything before the first one, or as of an
        earlier moment, but where a sensor errs a state is asked for, and p is about readings."""
        first = self.model.location.first_time
        read = first is not None and min(self.query.time, self.as_of) >= first
        return self.query.given == "observations" and (read or detector_of(self.model) is not None)

    def readings_version(self) -> tuple[object, ...] | None:
        """What changes whenever other readings are used, or used otherwise; None where none are.

        Moments after all that the latest reading stands for are alike.
        """
        if self.query.given == "model" and not self.query.last_seen:
            return None
        location = self.model.location
        stands = self.as_of if location.last_time is None else location.last_time + (location.hold_s or 0.0)
        counted = (location.observation_seq, location.deleted, location.first_time)
        return min(self.as_of, self.now, stands), *counted, location.hold_samples, str(location.sensor)

    def facts(self, damaged: Collection[int] = ()) -> StateFacts:
        """What the answer says of itself; damaged: chunks whose readings are, beside those of the model."""
        location, revision = self.model.location, self.model.revision
        return StateFacts(
            location_id=location.id,
            time=self.query.time,
            as_of=self.as_of,
            given=self.query.given,
            confidence=self.confidence,
            estimator=revision.estimator,
            order=revision.order,
            revision=revision.revision,
            shape=location.cells.shape,
            grid=location.grid,
            unavailable=location.cell_ranges({*self.model.damage, *damaged}),
        )


def ask(ctx: Context, name: str, query: StateQuery, claim: Claim | None = None) -> Asked:
    """What answers a question; nothing is computed yet.

    Raises LocationNotFoundError, NoModelError, CorruptChunkError, UnauthorizedError, and InvalidInputError where more
    of a large location is asked for than is held at once.
    """
    now = ctx.clock()
    as_of = now if query.as_of is None else query.as_of
    part = in_box(query.bbox)
    return Asked(query, fitted(ctx, name, query.estimator, query.order, claim, part), as_of, now)


def state_at(ctx: Context, name: str, query: StateQuery) -> StateView:
    """The state at a time. Raises LocationNotFoundError, NoModelError, InvalidInputError."""
    return view_of(ctx, ask(ctx, name, query))


def view_of(ctx: Context, asked: Asked) -> StateView:
    """The answer in arrays. Raises InvalidInputError."""
    query, model, location = asked.query, asked.model, asked.model.location
    cell, probability = _asked_for(ctx, asked)
    known = _known_at(ctx, asked, cell)
    if known is not None and asked.conditioned:
        probability = known.at(probability, query.time)
    seen = observed_at(ctx, model, cell, query.time) if query.observed else None
    damaged = (*(() if seen is None else seen.damaged), *(() if known is None else known.damaged))
    facts = asked.facts(damaged)
    return StateView(
        **{each.name: getattr(facts, each.name) for each in fields(facts)},
        cell=cell,
        probability=probability,
        state=state(probability, asked.confidence),
        verdict=verdict(probability, asked.confidence),
        observed=None if seen is None else seen.state,
        observed_time=None if seen is None else _start(location, seen.sample),
        last_seen=_start(location, known.evidence.sample) if known is not None and query.last_seen else None,
    )


def _known_at(ctx: Context, asked: Asked, cells: NDArray[np.int64]) -> Known | None:
    """What was known of some cells as of the moment asked for, where the answer needs it."""
    if not asked.conditioned and not asked.query.last_seen:
        return None
    return known_at(ctx, asked.model, cells, asked.as_of)


@dataclass(frozen=True, slots=True, eq=False)
class BufferedState:
    """The state of a whole map as it is sent in Arrow."""

    facts: StateFacts
    lease: BufferLease[StateBuffer]


def buffer_of(ctx: Context, asked: Asked) -> BufferedState | None:
    """The answer as it is sent in Arrow; None where it is not about a whole map, or asks for what is not kept."""
    query, model = asked.query, asked.model
    if query.bbox is not None or query.last_seen or model.chunks is not None:
        return None
    seen = map_seen(ctx, model, query.time) if query.observed else None
    if query.observed and seen is None:
        return None
    known = _known_at(ctx, asked, model.loaded.known)
    lease, threads = _leased(ctx, asked, seen), ctx.settings.update_threads
    if known is None:
        lease.value.write(model.spectrum, query.time, threads)
        return BufferedState(asked.facts(), lease)
    lease.value.write_given(model.spectrum, query.time, known.conditioning(query.time), threads)
    return BufferedState(asked.facts(known.damaged), lease)


def _leased(ctx: Context, asked: Asked, seen: MapSeen | None) -> BufferLease[StateBuffer]:
    """A buffer whose columns of what was last seen are right, where it is to have them."""
    model, confidence = asked.model, asked.confidence
    key = (model.location.id, model.revision.recipe, confidence, seen is None)
    version = (ref(model.loaded), None if seen is None else seen.version)

    def make() -> StateBuffer:
        more = NOTHING if seen is None else _seen_columns(model.location, seen)
        return StateBuffer.of(model.spectrum, confidence, more)

    return ctx.caches.buffers.lease(key, version, make)


def _seen_columns(location: LocationRecord, seen: MapSeen) -> dict[str, Column]:
    found = seen.last_seen()
    return seen_columns(found.state, _start(location, found.sample))


def grid_of(ctx: Context, asked: Asked) -> NDArray[np.float32]:
    """The probability of all cells, in the location's shape; NaN where never observed or outside of the box.

    Raises InvalidInputError where that is too large.
    """
    refuse_large(ctx, asked.model.location)
    shape, spectrum = asked.model.location.cells.shape, asked.model.spectrum
    if asked.query.bbox is None and not asked.conditioned:
        return predict(spectrum, asked.query.time, threads=ctx.settings.update_threads).reshape(shape)
    grid = np.full(spectrum.n_cells, np.nan, np.float32)
    cell, probability = _asked_for(ctx, asked)
    known = _known_at(ctx, asked, cell)
    grid[cell] = known.at(probability, asked.query.time) if known is not None and asked.conditioned else probability
    return grid.reshape(shape)


def _asked_for(ctx: Context, asked: Asked) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """The cells that have been observed, of those in the box if there is one, and their probability."""
    model, query = asked.model, asked.query
    if query.bbox is None and model.chunks is None:
        return _known(predict(model.spectrum, query.time, threads=ctx.settings.update_threads))
    cell = cells_in(model, query.bbox)
    return cell, model.predict(query.time, cell)


def cells_in(model: Fitted, bbox: tuple[float, ...] | None) -> NDArray[np.int64]:
    """The cells that have been observed, of those in a box if there is one, ascending. Raises InvalidInputError."""
    if bbox is None:
        return model.known
    if model.location.grid is None:
        raise InvalidInputError.at("bbox", "a location of kind 'state' has no extent; leave bbox out")
    return model.known[model.location.grid.runs(bbox).among(model.known)]


def _known(probability: NDArray[np.float32]) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """The cells that have been observed, and their probability."""
    missing = np.isnan(probability)
    if not missing.any():
        return np.arange(len(probability)), probability
    cell = np.flatnonzero(~missing)
    return cell, probability[cell]


def _start(location: LocationRecord, sample: NDArray[np.int64]) -> NDArray[np.float64]:
    """The times of samples, NaN for NEVER."""
    start = location.base.time(sample)
    start[sample == NEVER] = np.nan
    return start

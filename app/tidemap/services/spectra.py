"""The spectrum that answers a question: the stored one, or one refitted on its window at another order."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tidemap.errors import CorruptChunkError, NoModelError
from tidemap.history.chunks import CHUNK_CELLS
from tidemap.services.context import Context, Loaded
from tidemap.services.history import read_history, window
from tidemap.services.keys import Claim, confirm
from tidemap.services.parts import WHOLE, LocationPart, check_size, is_whole
from tidemap.spectral.model import fit_part
from tidemap.spectral.prediction import predict
from tidemap.spectral.recipe import ORDER, Recipe
from tidemap.spectral.spectrum import Spectrum, blank, concatenate, static, truncate
from tidemap.storage.records import LocationRecord, RevisionRecord

Integer = TypeVar("Integer", bound=np.integer)


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """A spectrum of all cells of a location, or of some chunks, and the revision it came from.

    Cells of the chunks in `damage` look as if never observed. chunks: those that the spectrum has the cells of, one
    after the other; None: all.
    """

    location: LocationRecord
    loaded: Loaded
    chunks: NDArray[np.int64] | None = None

    @property
    def revision(self) -> RevisionRecord:
        """What it was fitted by, or as if."""
        return self.loaded.revision

    @property
    def spectrum(self) -> Spectrum:
        """All cells."""
        return self.loaded.spectrum

    @property
    def known(self) -> NDArray[np.int64]:
        """The cells that have been observed, ascending."""
        known = self.loaded.known
        if self.chunks is None:
            return known
        return self.chunks[known // CHUNK_CELLS] * CHUNK_CELLS + known % CHUNK_CELLS

    @property
    def held_chunks(self) -> Sequence[int]:
        """The chunks whose cells the spectrum has, ascending."""
        return range(self.location.n_chunks) if self.chunks is None else self.chunks.tolist()

    def rows(self, cells: NDArray[Integer]) -> NDArray[Integer]:
        """Where the spectrum has these cells, all of them in its chunks."""
        if self.chunks is None:
            return cells
        at = np.searchsorted(self.chunks, cells // CHUNK_CELLS)
        return (at * CHUNK_CELLS + cells % CHUNK_CELLS).astype(cells.dtype)

    def predict(self, time: float, cells: NDArray[np.int64]) -> NDArray[np.float32]:
        """The model's p (n,) of some cells at a time, as `prediction.predict`."""
        return predict(self.spectrum, time, self.rows(cells))

    @property
    def damage(self) -> Mapping[int, CorruptChunkError]:
        """What is wrong with the chunks that cannot be read."""
        return self.loaded.damage

    @property
    def unavailable(self) -> list[tuple[int, int]]:
        """Ranges [first, stop) of the cells whose spectrum is damaged, ascending."""
        return self.location.cell_ranges(self.damage)

    def check_readable(self, cells: ArrayLike) -> None:
        """Raises CorruptChunkError where one of the cells is unavailable."""
        for chunk in np.unique(np.asarray(cells, np.int64) // CHUNK_CELLS).tolist() if self.damage else ():
            if (error := self.damage.get(chunk)) is not None:
                raise CorruptChunkError(error.what, error.why)


def fitted(
    ctx: Context,
    name: str,
    estimator: str | None = None,
    order: int | None = None,
    claim: Claim | None = None,
    part: LocationPart = WHOLE,
) -> Fitted:
    """The spectrum of the current revision, at another order or by another estimator where asked: of all cells, or of
    a large location of a part.

    Raises LocationNotFoundError, NoModelError, CorruptChunkError where no chunk of it can be read, UnauthorizedError
    where a claim is not true any more, InvalidInputError where the part is too large. A refit reads the window's
    history; its result is cached.
    """
    location, revision = current_revision(ctx, name, claim)
    while True:
        wanted = _wanted(location, revision, estimator, order)
        try:
            return _fitted(ctx, location, revision, wanted, part)
        except CorruptChunkError:
            before = revision
            location, revision = current_revision(ctx, name)
            if revision.revision == before.revision:
                raise
            # An update took its location, and its chunks away, before they were loaded.


def _fitted(
    ctx: Context, location: LocationRecord, revision: RevisionRecord, wanted: RevisionRecord, part: LocationPart
) -> Fitted:
    if is_whole(ctx, location):
        key = (location.id, None if wanted.recipe == revision.recipe else wanted.recipe)
        load = partial(_load, ctx, location, revision, wanted)
        return Fitted(location, ctx.caches.spectra.get(key, revision.revision, load))
    everything = np.arange(location.n_chunks)
    chunks = part.chunks(location, everything if revision.chunks is None else revision.chunks)
    check_size(ctx, chunks)
    return Fitted(location, _load_part(ctx, location, revision, wanted, chunks), chunks)


def stored(ctx: Context, location: LocationRecord, revision: RevisionRecord) -> Fitted:
    """The spectrum of a revision as it is stored. Raises CorruptChunkError."""
    key, load = (location.id, None), partial(_stored, ctx, location, revision)
    return Fitted(location, ctx.caches.spectra.get(key, revision.revision, load))


def held_fit(ctx: Context, location: LocationRecord) -> Loaded | None:
    """The spectrum of all cells by the location's revision where the cache has it: what it costs is one look."""
    return ctx.caches.spectra.held((location.id, None), location.revision)


def current_revision(ctx: Context, name: str, claim: Claim | None = None) -> tuple[LocationRecord, RevisionRecord]:
    """Raises LocationNotFoundError, NoModelError, UnauthorizedError."""
    with ctx.store.read() as work:
        if claim is not None:
            confirm(work, claim)
        location = work.locations.get(name)
        loaded = held_fit(ctx, location)
        revision = work.spectra.get(location.id, location.revision) if loaded is None else loaded.revision
    if revision is None:
        raise NoModelError(name)
    return location, revision


def _wanted(
    location: LocationRecord, revision: RevisionRecord, estimator: str | None, order: int | None
) -> RevisionRecord:
    """The revision as if it had been fitted with this estimator and order."""
    if estimator is None and order is None:
        return revision
    return replace(revision, recipe=recipe_for(location, revision, estimator or revision.estimator, order))


def recipe_for(location: LocationRecord, revision: RevisionRecord, estimator: str, order: int | None) -> Recipe:
    """How to fit a location by some estimator: as its revision does where that has the same."""
    if estimator == "static":
        return Recipe(estimator, 0, location.time_zone, calendar=location.calendar)
    if estimator == revision.estimator:
        return revision.recipe if order is None else replace(revision.recipe, order=order)
    order = DEFAULT_ORDER[estimator] if order is None else order
    return Recipe(estimator, order, location.time_zone, calendar=location.calendar)


DEFAULT_ORDER = {"fft": 3, "calendar": ORDER}
"""Order of another estimator than the revision's when none is asked for; of `fft` the paper's best for prediction."""


def _load(ctx: Context, location: LocationRecord, stored: RevisionRecord, wanted: RevisionRecord) -> Loaded:
    """All cells."""
    if wanted.recipe == stored.recipe:
        return _stored(ctx, location, stored)
    if _is_truncated(stored, wanted):
        whole = _stored(ctx, location, stored)
        return Loaded(wanted, truncate(whole.spectrum, wanted.order), whole.damage)
    chunks = np.arange(location.n_chunks)
    return _joined(ctx, location, wanted, chunks, dict(_refitted(ctx, location, stored, wanted, chunks)))


def _stored(ctx: Context, location: LocationRecord, revision: RevisionRecord) -> Loaded:
    chunks = np.arange(location.n_chunks)
    return _joined(ctx, location, revision, chunks, dict(_read(ctx, location, revision, chunks)))


def _load_part(
    ctx: Context, location: LocationRecord, stored: RevisionRecord, wanted: RevisionRecord, chunks: NDArray[np.int64]
) -> Loaded:
    """The cells of some chunks, which are kept each for itself."""
    if _is_truncated(stored, wanted):
        part = _load_part(ctx, location, stored, stored, chunks)
        return Loaded(wanted, truncate(part.spectrum, wanted.order), part.damage)
    same = wanted.recipe == stored.recipe
    recipe, version, cache = None if same else wanted.recipe, stored.revision, ctx.caches.spectra
    held = {chunk: cache.held((location.id, recipe, chunk), version) for chunk in chunks.tolist()}
    found: dict[int, Spectrum | CorruptChunkError] = {c: each.spectrum for c, each in held.items() if each is not None}
    missing = np.array([chunk for chunk, each in held.items() if each is None], np.int64)
    read = _read(ctx, location, stored, missing) if same else _refitted(ctx, location, stored, wanted, missing)
    for chunk, value in read:
        found[chunk] = value
        if isinstance(value, Spectrum):
            cache.get((location.id, recipe, chunk), version, partial(Loaded, wanted, value, {}))
    return _joined(ctx, location, wanted, chunks, found)


def _is_truncated(stored: RevisionRecord, wanted: RevisionRecord) -> bool:
    """Whether what is wanted is a part of what is stored."""
    return wanted.estimator == stored.estimator == "fft" and wanted.order < stored.order


Found = Iterator[tuple[int, Spectrum | CorruptChunkError]]
"""Chunks with their spectra, or what is wrong with them; those where nothing was ever seen are left out."""


def _read(ctx: Context, location: LocationRecord, revision: RevisionRecord, chunks: NDArray[np.int64]) -> Found:
    """What is stored of some chunks."""
    if revision.chunks is not None:
        chunks = chunks[np.isin(chunks, revision.chunks)]
    with ctx.store.read() as work:
        for chunk in chunks.tolist():
            try:
                yield chunk, work.spectra.chunk(location, revision.revision, chunk)
            except CorruptChunkError as error:
                yield chunk, error.with_traceback(None)


def _refitted(
    ctx: Context, location: LocationRecord, stored: RevisionRecord, wanted: RevisionRecord, chunks: NDArray[np.int64]
) -> Found:
    """Some chunks, fitted to their history as is wanted."""
    known, part = window(ctx, location), (stored.start, stored.stop)
    for chunk in chunks.tolist():
        try:
            history = read_history(ctx, location, chunk, *known)
        except CorruptChunkError as error:
            yield chunk, error.with_traceback(None)
        else:
            yield chunk, fit_part(history, wanted.recipe, location.base, part)


def _joined(
    ctx: Context,
    location: LocationRecord,
    revision: RevisionRecord,
    chunks: NDArray[np.int64],
    found: Mapping[int, Spectrum | CorruptChunkError],
) -> Loaded:
    """The spectra of chunks as one, blank where a chunk is damaged or was never seen. CorruptChunkError where all are
    damaged."""
    parts = {chunk: each for chunk, each in found.items() if isinstance(each, Spectrum)}
    damage = {chunk: each for chunk, each in found.items() if isinstance(each, CorruptChunkError)}
    if damage and not parts:
        raise next(iter(damage.values()))
    for error in damage.values():
        ctx.damage.found(location.id, error)
    like = next(iter(parts.values()), static(np.zeros(0, np.float32), location.base))
    every = [parts.get(chunk) or blank(like, location.chunk_size(chunk)) for chunk in chunks.tolist()]
    return Loaded(revision, concatenate(every or [like]), damage)

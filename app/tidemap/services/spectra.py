"""The spectrum that answers a question: the stored one, or one refitted on its window at another order."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from tidemap.errors import CorruptChunkError, NoModelError
from tidemap.history.chunks import CHUNK_CELLS
from tidemap.services.context import Context, Loaded
from tidemap.services.history import read_history, window
from tidemap.services.keys import Claim, confirm
from tidemap.spectral.model import fit_part
from tidemap.spectral.recipe import ORDER, Recipe
from tidemap.spectral.spectrum import Spectrum, blank, concatenate, truncate
from tidemap.storage.records import LocationRecord, RevisionRecord


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """A spectrum of all cells of a location and the revision it came from.

    Cells of the chunks in `damage` look as if never observed.
    """

    location: LocationRecord
    loaded: Loaded

    @property
    def revision(self) -> RevisionRecord:
        """What it was fitted by, or as if."""
        return self.loaded.revision

    @property
    def spectrum(self) -> Spectrum:
        """All cells."""
        return self.loaded.spectrum

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
    ctx: Context, name: str, estimator: str | None = None, order: int | None = None, claim: Claim | None = None
) -> Fitted:
    """The spectrum of the current revision, at another order or by another estimator where asked.

    Raises LocationNotFoundError, NoModelError, CorruptChunkError where no chunk of it can be read, UnauthorizedError
    where a claim is not true any more. A refit reads the window's history; its result is cached.
    """
    location, revision = current_revision(ctx, name, claim)
    while True:
        wanted = _wanted(location, revision, estimator, order)
        key = (location.id, None if wanted.recipe == revision.recipe else wanted.recipe)
        load = partial(_load, ctx, location, revision, wanted)
        try:
            return Fitted(location, ctx.caches.spectra.get(key, revision.revision, load))
        except CorruptChunkError:
            before = revision
            location, revision = current_revision(ctx, name)
            if revision.revision == before.revision:
                raise
            # An update took its location, and its chunks away, before they were loaded.


def stored(ctx: Context, location: LocationRecord, revision: RevisionRecord) -> Fitted:
    """The spectrum of a revision as it is stored. Raises CorruptChunkError."""
    key, load = (location.id, None), partial(_stored, ctx, location, revision)
    return Fitted(location, ctx.caches.spectra.get(key, revision.revision, load))


def held(ctx: Context, location: LocationRecord) -> Spectrum | None:
    """The spectrum of the location's revision where the cache has it: what it costs is one look."""
    loaded = held_fit(ctx, location)
    return None if loaded is None else loaded.spectrum


def held_fit(ctx: Context, location: LocationRecord) -> Loaded | None:
    """The same with the revision and what is damaged."""
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
    if wanted.recipe == stored.recipe:
        return _stored(ctx, location, stored)
    if wanted.estimator == stored.estimator == "fft" and wanted.order < stored.order:
        whole = _stored(ctx, location, stored)
        return Loaded(wanted, truncate(whole.spectrum, wanted.order), whole.damage)
    known, part = window(ctx, location), (stored.start, stored.stop)

    def fit(chunk: int) -> Spectrum:
        return fit_part(read_history(ctx, location, chunk, *known), wanted.recipe, location.base, part)

    return _whole(ctx, location, wanted, fit)


def _stored(ctx: Context, location: LocationRecord, revision: RevisionRecord) -> Loaded:
    with ctx.store.read() as work:
        return _whole(ctx, location, revision, lambda chunk: work.spectra.chunk(location, revision.revision, chunk))


def _whole(ctx: Context, location: LocationRecord, revision: RevisionRecord, read: Callable[[int], Spectrum]) -> Loaded:
    """The spectra of all chunks as one, blank where a chunk is damaged. CorruptChunkError where all are."""
    parts: dict[int, Spectrum] = {}
    damage: dict[int, CorruptChunkError] = {}
    for chunk in range(location.n_chunks):
        try:
            parts[chunk] = read(chunk)
        except CorruptChunkError as error:
            damage[chunk] = error.with_traceback(None)
    if not parts:
        raise damage[0]
    for chunk, found in damage.items():
        ctx.damage.found(location.id, found)
        parts[chunk] = blank(next(iter(parts.values())), location.chunk_size(chunk))
    return Loaded(revision, concatenate([parts[chunk] for chunk in range(location.n_chunks)]), damage)

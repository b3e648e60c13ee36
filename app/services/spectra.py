"""The spectrum that answers a question: the stored one, or one refitted on its window at another order."""

from dataclasses import dataclass, replace
from functools import partial

from app.errors import CorruptChunkError, NoModelError
from app.services.context import Context
from app.services.history import read_history, window
from app.spectral.model import fit_part
from app.spectral.recipe import ORDER, Recipe
from app.spectral.spectrum import Spectrum, concatenate, truncate
from app.storage.records import LocationRecord, RevisionRecord


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """A spectrum of all cells of a location and the revision it came from."""

    place: LocationRecord
    revision: RevisionRecord
    spectrum: Spectrum


def fitted(ctx: Context, name: str, estimator: str | None = None, order: int | None = None) -> Fitted:
    """The spectrum of the current revision, at another order or by another estimator where asked.

    Raises LocationNotFoundError, NoModelError. A refit reads the window's history; its result is cached.
    """
    place, revision = current_revision(ctx, name)
    while True:
        wanted = _wanted(place, revision, estimator, order)
        key = (place.id, None if wanted.recipe == revision.recipe else wanted.recipe)
        load = partial(_load, ctx, place, revision, wanted)
        try:
            return Fitted(place, wanted, ctx.spectra.get(key, revision.revision, load))
        except CorruptChunkError:
            before = revision
            place, revision = current_revision(ctx, name)
            if revision.revision == before.revision:
                raise
            # An update took its place, and its chunks away, before they were loaded.


def held(ctx: Context, place: LocationRecord) -> Spectrum | None:
    """The spectrum of the location's revision where the cache has it: what it costs is one look."""
    return ctx.spectra.held((place.id, None), place.revision)


def current_revision(ctx: Context, name: str) -> tuple[LocationRecord, RevisionRecord]:
    """Raises LocationNotFoundError, NoModelError."""
    with ctx.store.read() as work:
        place = work.locations.get(name)
        revision = work.spectra.get(place.id, place.revision)
    if revision is None:
        raise NoModelError(name)
    return place, revision


def _wanted(
    place: LocationRecord, revision: RevisionRecord, estimator: str | None, order: int | None
) -> RevisionRecord:
    """The revision as if it had been fitted with this estimator and order."""
    return replace(revision, recipe=recipe_for(place, revision, estimator or revision.estimator, order))


def recipe_for(place: LocationRecord, revision: RevisionRecord, estimator: str, order: int | None) -> Recipe:
    """How to fit a location by some estimator: as its revision does where that has the same."""
    if estimator == "static":
        return Recipe(estimator, 0, place.time_zone)
    if estimator == revision.estimator:
        return revision.recipe if order is None else replace(revision.recipe, order=order)
    return Recipe(estimator, DEFAULT_ORDER[estimator] if order is None else order, place.time_zone)


DEFAULT_ORDER = {"fft": 3, "calendar": ORDER}
"""Order of another estimator than the revision's when none is asked for; of `fft` the paper's best for prediction."""


def _load(ctx: Context, place: LocationRecord, stored: RevisionRecord, wanted: RevisionRecord) -> Spectrum:
    if wanted.recipe == stored.recipe:
        return _stored(ctx, place, stored)
    if wanted.estimator == stored.estimator == "fft" and wanted.order < stored.order:
        return truncate(_stored(ctx, place, stored), wanted.order)
    known, part = window(ctx, place), (stored.start, stored.stop)
    return concatenate(
        [
            fit_part(read_history(ctx, place.name, chunk, *known), wanted.recipe, place.base, part)
            for chunk in range(place.n_chunks)
        ]
    )


def _stored(ctx: Context, place: LocationRecord, revision: RevisionRecord) -> Spectrum:
    with ctx.store.read() as work:
        return concatenate([work.spectra.chunk(place, revision.revision, chunk) for chunk in range(place.n_chunks)])

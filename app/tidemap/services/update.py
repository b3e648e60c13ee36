"""Update: refit spectrum and outliers of a location from its history (the paper's model update)."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import CorruptChunkError, InvalidInputError
from tidemap.history.history import History
from tidemap.services.compaction import compact, forget
from tidemap.services.context import Context
from tidemap.services.history import read_compacted, window
from tidemap.services.update_task import ChunkFit, Executor, Plan, UpdateTask, run_task
from tidemap.spectral.auto.selection import Choice, choose
from tidemap.spectral.conditioning import Persistence
from tidemap.spectral.evaluation import accuracy
from tidemap.spectral.model import fit_part
from tidemap.spectral.persistence import learn_persistence
from tidemap.spectral.window import PAUSE_S, fft_window
from tidemap.storage.records import LocationRecord, RevisionRecord
from tidemap.storage.work import Work

SELECTION_CELLS = 64
"""Changing cells that decide for all."""
PERSISTENCE_CELLS = 16
"""Changing cells, or chunks that they are looked for in, that tell how long states last."""
PAUSE_CHUNKS = 8
"""Chunks whose pauses are those of all."""
ORDERS = (1, 2, 3, 5, 10, 15)
"""Orders of `fft` that are tried."""


@dataclass(frozen=True, slots=True)
class UpdateRequest:
    """What to fit; None leaves the choice to the location's settings and to `fft_window`."""

    start: float | None = None
    stop: float | None = None
    estimator: str | None = None
    order: int | str | None = None


def run_update(
    ctx: Context,
    location_id: int,
    request: UpdateRequest,
    executor: Executor,
    progress: Callable[[float], None],
    also: Callable[[Work, RevisionRecord], object] = lambda work, revision: None,
) -> RevisionRecord:
    """A new revision, visible once its last chunk is stored. Chunks whose history is damaged are left out of it.

    `also` writes in the transaction that makes it visible.
    Raises LocationNotFoundError, InvalidInputError when there is nothing to fit, CorruptChunkError when nothing of it
    can be read, ShuttingDownError when the executor is closed.
    """
    with ctx.store.read() as work:
        location = work.locations.by_id(location_id)
    compact(ctx, location, executor.check)
    forget(ctx, location)
    progress(0.1)
    plan, tried = _plan(ctx, location, request, executor.check)
    fits = _fit_chunks(ctx, plan, executor, progress)
    fitted_share = accuracy(sum(fit.outliers for fit in fits), sum(fit.observed for fit in fits))
    record = _revision(ctx, plan, tried, fitted_share, _persistence(ctx, plan, executor.check))

    def publish(work: Work) -> None:
        work.spectra.publish(record)
        also(work, record)

    ctx.store.write(publish, lambda _: ctx.caches.locations.forget())
    ctx.caches.spectra.drop(lambda key: isinstance(key, tuple) and key[0] == plan.location.id)
    return record


def _fit_chunks(ctx: Context, plan: Plan, executor: Executor, progress: Callable[[float], None]) -> list[ChunkFit]:
    """Fit and store every chunk that can be read. Raises CorruptChunkError where none can."""
    n_chunks = plan.location.n_chunks
    tasks = [UpdateTask(plan, chunk, ctx.term) for chunk in range(n_chunks)]
    fits: list[ChunkFit] = []
    damage: list[CorruptChunkError] = []
    for done, fit in enumerate(executor.map(run_task, tasks), 1):
        if isinstance(fit, CorruptChunkError):
            damage.append(fit)
        else:
            fits.append(fit)
        progress(0.1 + 0.9 * done / n_chunks)
    if not fits:
        raise damage[0]
    if not damage:
        ctx.damage.forget(plan.location.id)
    return fits


def _plan(
    ctx: Context, before: LocationRecord, request: UpdateRequest, check: Callable[[], None]
) -> tuple[Plan, Choice | None]:
    """The plan of an update of what had come in `before`, and how `auto` chose; what came in since waits."""
    with ctx.store.read() as work:
        location = _limited(work.locations.by_id(before.id), before)
        number = work.spectra.next_number(location.id)
    history = window(ctx, location)
    asked = _asked_samples(location, history, request)
    selection = _select(ctx, location, asked, request, check)
    start, stop = asked
    if selection.estimator == "fft" and request.start is None and request.stop is None:
        start, stop = fft_window(_seen(ctx, location, asked, check), start, stop, location.interval_s)
    tried = selection if selection.reason else None
    return Plan(location, number, selection.recipe, start, stop, history), tried


def _limited(now: LocationRecord, before: LocationRecord) -> LocationRecord:
    """The location as it is now, without what it has counted since."""
    if now.first_time is None or now.last_time is None or before.first_time is None or before.last_time is None:
        return replace(now, first_time=None, last_time=None)
    return replace(
        now,
        observation_seq=before.observation_seq,
        measurements=min(now.measurements, before.measurements),
        first_time=max(now.first_time, before.first_time),
        last_time=min(now.last_time, before.last_time),
    )


def _persistence(ctx: Context, plan: Plan, check: Callable[[], None]) -> Persistence:
    """How long states last, learned from some changing cells.

    Their fit leaves out what is followed of the last day: it is no rhythm that a reading could add to.
    """
    location = plan.location
    sampled = _sample_cells(ctx, location, plan.history, check, PERSISTENCE_CELLS)
    recipe = replace(plan.recipe, carry_over=0.0)
    check()
    spectrum = fit_part(sampled, recipe, location.base, (plan.start, plan.stop))
    return learn_persistence(sampled, spectrum, location.base)


def _asked_samples(location: LocationRecord, history: tuple[int, int], request: UpdateRequest) -> tuple[int, int]:
    """The part of the history to learn from, by default all of it."""
    first, last = history
    if last <= first:
        raise InvalidInputError.at("location", f"{location.name!r} has no observations yet; post some first")
    start, stop = location.base.clamp(history, request.start, request.stop)
    if stop <= start:
        raise InvalidInputError.at("stop", "nothing was observed between start and stop; widen the window")
    return start, stop


def _select(
    ctx: Context, location: LocationRecord, samples: tuple[int, int], request: UpdateRequest, check: Callable[[], None]
) -> Choice:
    """`auto`, within what the request and the location leave open; without a reason where they leave nothing."""
    estimator = request.estimator or location.estimator
    order = request.order if request.order is not None else (location.order or "auto")
    if estimator == "static":
        return Choice(estimator, 0, (), "", 0, location.time_zone, calendar=location.calendar)
    if estimator == "fft" and isinstance(order, int):
        return Choice(estimator, order, (), "", 0, location.time_zone, calendar=location.calendar)
    orders = ORDERS if order == "auto" else (int(order),)
    sampled = _sample_cells(ctx, location, samples, check, SELECTION_CELLS)
    zone = (location.time_zone, estimator, check, location.calendar)
    return choose(sampled, location.base, orders, SELECTION_CELLS, *zone)


def _sample_cells(
    ctx: Context, location: LocationRecord, samples: tuple[int, int], check: Callable[[], None], n_cells: int
) -> History:
    """The histories of about `n_cells` to four times as many changing cells, spread evenly over some chunks that can
    be read."""
    n_chunks = min(location.n_chunks, n_cells)
    parts = [History.empty(0, samples[0], samples[1] - samples[0])]
    for history in _sample_chunks(ctx, location, samples, check, n_chunks):
        changing = history.changing()
        step = max(1, len(changing) * n_chunks // (4 * n_cells))
        parts.append(history.cells(changing[::step]))
    return History.stack(parts)


def _seen(
    ctx: Context, location: LocationRecord, samples: tuple[int, int], check: Callable[[], None]
) -> NDArray[np.int64]:
    """The samples in which something was seen in some chunks; all where they are too few for a pause."""
    if (samples[1] - samples[0]) * location.interval_s <= PAUSE_S:
        return np.arange(*samples)
    seen = [history.seen() for history in _sample_chunks(ctx, location, samples, check, PAUSE_CHUNKS)]
    return np.unique(np.concatenate([np.zeros(0, np.int64), *seen]))


def _sample_chunks(
    ctx: Context, location: LocationRecord, samples: tuple[int, int], check: Callable[[], None], n_chunks: int
) -> Iterator[History]:
    """The histories of `n_chunks` chunks at most, spread evenly, that can be read."""
    for chunk in np.linspace(0, location.n_chunks - 1, min(location.n_chunks, n_chunks)).astype(int).tolist():
        check()
        with suppress(CorruptChunkError):
            yield read_compacted(ctx, location, chunk, *samples)


def _revision(
    ctx: Context, plan: Plan, tried: Choice | None, accuracy: float | None, persistence: Persistence
) -> RevisionRecord:
    return RevisionRecord(
        location_id=plan.location.id,
        revision=plan.number,
        recipe=plan.recipe,
        start=plan.start,
        stop=plan.stop,
        observation_seq=plan.location.observation_seq,
        measurements=plan.location.observations,
        accuracy=accuracy,
        updated_at=ctx.clock(),
        selection=None if tried is None else _stored(tried),
        persistence=persistence,
    )


def _stored(selection: Choice) -> dict[str, Any]:
    """The choice as it is kept; a score that is no number is null."""
    rows = [asdict(row) for row in selection.table]
    for row in rows:
        row.update({name: None for name in ("error", "brier", "log_loss") if row[name] != row[name]})
    return {
        "estimator": selection.estimator,
        "order": selection.order,
        "reason": selection.reason,
        "cells": selection.cells,
        "scores": rows,
    }

"""Update: refit spectrum and outliers of a location from its history (the paper's model update)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import CorruptChunkError, InvalidInputError
from tidemap.history.sequences import Sequences
from tidemap.services.compaction import compact, forget
from tidemap.services.context import Context
from tidemap.services.history import window
from tidemap.services.parts import is_whole, seen_chunks
from tidemap.services.sampling import SampledCells, measured, sample_cells
from tidemap.services.selection import SELECTION_CELLS, selected, settled
from tidemap.services.update_task import ChunkFit, Executor, Plan, UpdateTask, run_task
from tidemap.spectral.auto.selection import Choice
from tidemap.spectral.conditioning import Persistence
from tidemap.spectral.detection import ReadCells, learn_detector
from tidemap.spectral.detector import Detector
from tidemap.spectral.evaluation import accuracy
from tidemap.spectral.model import fit_part
from tidemap.spectral.persistence import learn_lasting, learn_persistence
from tidemap.spectral.prediction import predict_readings
from tidemap.spectral.sensor import Sensor
from tidemap.spectral.spectrum import Spectrum
from tidemap.spectral.window import PAUSE_S, fft_window
from tidemap.storage.records import LocationRecord, RevisionRecord
from tidemap.storage.work import Work

PERSISTENCE_CELLS = 16
"""Changing cells, up to four times as many, that tell how long states last, and chunks that they are looked for in."""
MAX_DIFFERING = 64
"""Cells of a location up to which each may have states that last longer or shorter than the others'."""


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
    plan, tried, sampled = _plan(ctx, location, request, executor.check)
    chunks = seen_chunks(ctx, plan.location)
    fits = _fit_chunks(ctx, plan, chunks.tolist(), executor, progress)
    fitted_share = accuracy(sum(fit.outliers for fit in fits), sum(fit.observed for fit in fits))
    record = _revision(ctx, plan, tried, fitted_share, _learned(ctx, plan, sampled, executor.check))
    if not is_whole(ctx, plan.location):
        record = replace(record, chunks=chunks)

    def publish(work: Work) -> None:
        work.spectra.publish(record)
        also(work, record)

    ctx.store.write(publish, lambda _: ctx.caches.locations.forget())
    ctx.caches.spectra.drop(lambda key: isinstance(key, tuple) and key[0] == plan.location.id)
    return record


def _fit_chunks(
    ctx: Context, plan: Plan, chunks: Sequence[int], executor: Executor, progress: Callable[[float], None]
) -> list[ChunkFit]:
    """Fit and store every one of some chunks that can be read. Raises CorruptChunkError where none can."""
    tasks = [UpdateTask(plan, chunk, ctx.term) for chunk in chunks]
    fits: list[ChunkFit] = []
    damage: list[CorruptChunkError] = []
    for done, fit in enumerate(executor.map(run_task, tasks), 1):
        if isinstance(fit, CorruptChunkError):
            damage.append(fit)
        else:
            fits.append(fit)
        progress(0.1 + 0.9 * done / len(tasks))
    if damage and not fits:
        raise damage[0]
    if not damage:
        ctx.damage.forget(plan.location.id)
    return fits


def _plan(
    ctx: Context, before: LocationRecord, request: UpdateRequest, check: Callable[[], None]
) -> tuple[Plan, Choice | None, SampledCells]:
    """The plan of an update of what had come in `before`, how `auto` chose, and some of the cells; what came in since
    waits."""
    with ctx.store.read() as work:
        location = _limited(work.locations.by_id(before.id), before)
        number = work.spectra.next_number(location.id)
    history = window(ctx, location)
    asked = _asked_samples(location, history, request)
    wanted = _wanted(location, request)
    choice = settled(location, *wanted)
    sampled = sample_cells(ctx, location, history, check, PERSISTENCE_CELLS if choice else SELECTION_CELLS)
    selection = choice or selected(location, *wanted, sampled.history.window(*asked), check)
    start, stop = asked
    if selection.estimator == "fft" and request.start is None and request.stop is None:
        start, stop = fft_window(_seen(sampled, asked, location.interval_s), start, stop, location.interval_s)
    plan = Plan(location, number, selection.recipe, start, stop, history)
    return plan, selection if selection.reason else None, sampled


def _seen(sampled: SampledCells, samples: tuple[int, int], interval_s: float) -> NDArray[np.int64]:
    """The samples in which something was seen; all where they are too few for a pause."""
    if (samples[1] - samples[0]) * interval_s <= PAUSE_S:
        return np.arange(*samples)
    return sampled.seen_in(*samples)


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


@dataclass(frozen=True, slots=True, eq=False)
class _Learned:
    """How long states last at a location, by cell where they differ, and what errs in reading them."""

    persistence: Persistence
    offset: Mapping[int, float]
    detector: Detector | None


def _learned(ctx: Context, plan: Plan, some: SampledCells, check: Callable[[], None]) -> _Learned:
    """How long states last, learned from some changing cells, and what errs in reading them.

    Their fit leaves out what is followed of the last day: it is no rhythm that a reading could add to.
    """
    location, sampled = plan.location, some.thinned(4 * PERSISTENCE_CELLS)
    recipe = replace(plan.recipe, carry_over=0.0)
    check()
    spectrum = fit_part(sampled.history, recipe, location.base, (plan.start, plan.stop))
    if location.n_cells > MAX_DIFFERING:
        persistence, offset = learn_persistence(sampled.history, spectrum, location.base), {}
    else:
        lasting = learn_lasting(sampled.history, spectrum, location.base)
        pairs = zip(sampled.cell.tolist(), lasting.offset.round(2).tolist(), strict=True)
        persistence, offset = lasting.persistence, {cell: value for cell, value in pairs if value}
    detector = None if location.sensor is None else _detector(ctx, location, sampled, spectrum)
    return _Learned(persistence, offset, detector)


def _detector(ctx: Context, location: LocationRecord, sampled: SampledCells, spectrum: Spectrum) -> Detector:
    """What reads the cells, learned from some of them and their spectrum."""
    sequences = Sequences.of(measured(ctx, location, sampled))
    p = predict_readings(spectrum, np.arange(spectrum.n_cells), sequences, location.base).astype(np.float64)
    given = location.sensor if isinstance(location.sensor, Sensor) else None
    return learn_detector(ReadCells(sequences, p), location.interval_s, given)


def _asked_samples(location: LocationRecord, history: tuple[int, int], request: UpdateRequest) -> tuple[int, int]:
    """The part of the history to learn from, by default all of it."""
    first, last = history
    if last <= first:
        raise InvalidInputError.at("location", f"{location.name!r} has no observations yet; post some first")
    start, stop = location.base.clamp(history, request.start, request.stop)
    if stop <= start:
        raise InvalidInputError.at("stop", "nothing was observed between start and stop; widen the window")
    return start, stop


def _wanted(location: LocationRecord, request: UpdateRequest) -> tuple[str, int | str]:
    """Estimator and order, `auto` where the request and the location leave them open."""
    order = request.order if request.order is not None else (location.order or "auto")
    return request.estimator or location.estimator, order


def _revision(
    ctx: Context,
    plan: Plan,
    tried: Choice | None,
    accuracy: float | None,
    learned: _Learned,
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
        persistence=learned.persistence,
        offset=learned.offset,
        detector=learned.detector,
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

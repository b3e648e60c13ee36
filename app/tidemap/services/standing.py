"""Standing: judge what a location holds while nobody says anything, so that a door left open is noticed.

A post is judged when it comes in. What its last reading left standing is judged here, sample by sample, up to now.
"""

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import CorruptChunkError, InvalidInputError
from tidemap.history.chunks import CHUNK_CELLS
from tidemap.history.history import FREE, OCCUPIED, History
from tidemap.services.anomalies import anomaly_of
from tidemap.services.context import Context
from tidemap.services.detect import BLOCK_VALUES, search
from tidemap.services.grouping import Criterion
from tidemap.services.history import read_history, window
from tidemap.services.incidents import EventChange, store_events
from tidemap.services.messages import publish_events
from tidemap.services.parts import SEEN
from tidemap.services.spectra import Fitted, fitted
from tidemap.storage.records import SEEN_FREE, SEEN_OCCUPIED, AnomalyRecord, LocationRecord
from tidemap.storage.repositories.anomalies import AnomalyFilter
from tidemap.storage.work import Work

log = logging.getLogger(__name__)
MAX_SAMPLES = 10_000
"""Samples that are judged at once: after a long time without a server there may be many."""


def standing_locations(ctx: Context) -> list[LocationRecord]:
    """Those that hold what was read, have a model to judge it by, and have passed a sample that was not judged yet."""
    with ctx.store.read() as work:
        locations = work.locations.list()
    return [each for each in locations if each.missing == "hold" and each.revision and each.first_time is not None]


def judge_standing(ctx: Context, location: LocationRecord, check: Callable[[], None] = lambda: None) -> bool:
    """Judge the samples that have ended since a location was last judged; whether there are more to judge.

    What is surprising extends the events it continues; where a reading came late, they end with it. `check` is called
    first and between blocks; what it raises ends it.
    Raises LocationNotFoundError, NoModelError, CorruptChunkError.
    """
    check()
    model = fitted(ctx, location.name, part=SEEN)
    span = _span(ctx, model)
    if span.stop <= span.start:
        return False
    criterion = Criterion(model.location.confidence, "surprise", model.revision.revision)
    try:
        events = search(ctx, model, (span.start, span.stop), criterion, check)
    except InvalidInputError as error:
        log.warning("location %s: what it holds was not judged: %s", location.name, error)
        events = []
    stops = _refuted(ctx, span, check)
    ctx.store.write(
        lambda work: _store(work, span, events, stops, ctx.clock()), lambda changes: publish_events(ctx, changes)
    )
    return span.more


@dataclass(frozen=True, slots=True)
class _Span:
    """Samples [start, stop) of a location as it was when they were chosen; `more` follow."""

    location: LocationRecord
    start: int
    stop: int
    more: bool


def _span(ctx: Context, model: Fitted) -> _Span:
    """What is to be judged next: since the last time, or since what the model was fitted to.

    All that is left where nothing is held any more.
    """
    location = model.location
    judged, now = location.judged_to, int(location.base.sample(ctx.clock()))
    start = model.revision.stop if judged is None else int(location.base.sample(judged))
    stop = now if start >= window(ctx, location)[1] else min(now, start + MAX_SAMPLES)
    return _Span(location, start, stop, stop < now)


def _refuted(ctx: Context, span: _Span, check: Callable[[], None]) -> dict[int, float]:
    """When the events in a span stop, by their ids, of those that a reading that came late contradicts.

    What was published of each before the span stays, or its first sample; and what nothing read contradicts, though
    the model of today would not have found it: one incident is one event, whatever was learned while it lasted.
    """
    base, stops = span.location.base, {}
    bounds = float(base.time(span.start)), float(base.time(span.stop))
    with ctx.store.read() as work:
        events = work.anomalies.list(AnomalyFilter(span.location.id, start=bounds[0], stop=bounds[1]))
    for event in events:
        check()
        first, stop = max(int(base.sample(event.start)), span.start - 1), int(base.sample(min(event.stop, bounds[1])))
        stop = min(stop, first + MAX_SAMPLES)
        if (end := _end(ctx, span.location, event, (first, stop))) < stop:
            stops[event.id] = float(base.time(end))
    return stops


def _end(ctx: Context, location: LocationRecord, event: AnomalyRecord, samples: tuple[int, int]) -> int:
    """The end of the part of samples [first, stop), at least one, after which no cell is as the event saw it.

    Where a chunk cannot be read nothing is contradicted.
    """
    first, stop = samples
    end = first + 1
    for chunk in np.unique(event.cells // CHUNK_CELLS).tolist() if end < stop else ():
        mine = event.cells // CHUNK_CELLS == chunk
        try:
            history = read_history(ctx, location, chunk, end, stop).cells(event.cells[mine] % CHUNK_CELLS)
        except CorruptChunkError:
            return stop
        end = max(end, _shown_until(history, event.bits[mine, None]))
        if end == stop:
            return stop
    return end if len(event.cells) else stop


def _shown_until(history: History, bits: NDArray[np.uint8]) -> int:
    """The end of the last sample in which a cell was as it was seen, `bits` (n_cells, 1); latest first."""
    step = max(1, BLOCK_VALUES // history.n_cells)
    for high in range(history.stop, history.start, -step):
        low = max(history.start, high - step)
        states = history.window(low, high).states()
        shows = np.where(states == OCCUPIED, bits & SEEN_OCCUPIED, (states == FREE) * (bits & SEEN_FREE))
        shown = np.flatnonzero(shows.any(axis=0))
        if shown.size:
            return low + int(shown[-1]) + 1
    return history.start


def _store(
    work: Work, span: _Span, events: list[AnomalyRecord], stops: Mapping[int, float], now: float
) -> list[EventChange]:
    """Store what was found at a time, unless what was judged is out of date: then the next time finds it."""
    location, base = span.location, span.location.base
    start, stop = float(base.time(span.start)), float(base.time(span.stop))
    latest = work.locations.lock(location.id)
    if (latest.judged_to, latest.revision) != (location.judged_to, location.revision):
        return []
    if work.observations.any_since(location, stop):
        return []
    work.locations.judged(location.id, stop)
    cut = _cut(work, location, (start, stop), stops)
    changes = store_events(work, latest, events, now)
    known = {id_ for change in changes for id_ in (change.event.id, *change.joined)}
    return [
        *(EventChange(anomaly_of(location, event), "updated") for event in cut if event.id not in known),
        *changes,
    ]


def _cut(
    work: Work, location: LocationRecord, span: tuple[float, float], stops: Mapping[int, float]
) -> list[AnomalyRecord]:
    """End events in a span at `stops`."""
    events = [event for event in work.anomalies.near(location.id, *span) if event.damage is None]
    ends = [(event, stops.get(event.id, event.stop)) for event in events]
    return work.anomalies.change([replace(event, stop=stop) for event, stop in ends if stop < event.stop])

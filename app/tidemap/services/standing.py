"""Standing: judge what a location holds while nobody says anything, so that a door left open is noticed.

A post is judged when it comes in. What its last reading left standing is judged here, sample by sample, up to now.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace

from tidemap.errors import InvalidInputError
from tidemap.services.anomalies import anomaly_of
from tidemap.services.context import Context
from tidemap.services.detect import search
from tidemap.services.grouping import Criterion
from tidemap.services.incidents import EventChange, store_events
from tidemap.services.messages import publish_events
from tidemap.services.spectra import Fitted, fitted
from tidemap.storage.records import AnomalyRecord, LocationRecord
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

    What is surprising extends the events it continues; where a reading came late, they end with it.
    Raises LocationNotFoundError, NoModelError, CorruptChunkError.
    """
    model = fitted(ctx, location.name)
    span = _span(ctx, model)
    if span.stop <= span.start:
        return False
    criterion = Criterion(model.location.confidence, "surprise", model.revision.revision)
    try:
        events = search(ctx, model, (span.start, span.stop), criterion, check)
    except InvalidInputError as error:
        log.warning("location %s: what it holds was not judged: %s", location.name, error)
        events = []
    ctx.store.write(lambda work: _store(work, span, events), lambda changes: publish_events(ctx, changes))
    return span.more


@dataclass(frozen=True, slots=True)
class _Span:
    """Samples [start, stop) of a location as it was when they were chosen; `more` follow."""

    location: LocationRecord
    start: int
    stop: int
    more: bool


def _span(ctx: Context, model: Fitted) -> _Span:
    """What is to be judged next: since the last time, or since what the model was fitted to."""
    location = model.location
    judged, now = location.judged_to, int(location.base.sample(ctx.clock()))
    start = model.revision.stop if judged is None else int(location.base.sample(judged))
    stop = min(now, start + MAX_SAMPLES)
    return _Span(location, start, stop, stop < now)


def _store(work: Work, span: _Span, events: list[AnomalyRecord]) -> list[EventChange]:
    """Store what was found, unless what was judged is out of date: then the next time finds it."""
    location, base = span.location, span.location.base
    start, stop = float(base.time(span.start)), float(base.time(span.stop))
    now = work.locations.lock(location.id)
    if (now.judged_to, now.revision) != (location.judged_to, location.revision):
        return []
    if work.observations.any_since(location, stop):
        return []
    work.locations.judged(location.id, stop)
    before = _cut(work, location, start)
    changes = {change.event.id: change for change in store_events(work, location, events)}
    ended = [EventChange(anomaly_of(location, event), "updated") for event in before if event.id not in changes]
    return [*ended, *changes.values()]


def _cut(work: Work, location: LocationRecord, time: float) -> list[AnomalyRecord]:
    """End the events that go on at a time there, as what follows is judged anew."""
    crossing = [event for event in work.anomalies.near(location.id, time, time) if event.start < time < event.stop]
    ended = [replace(event, stop=time) for event in crossing if event.damage is None]
    work.anomalies.change(ended)
    return ended

"""Ending: events that nothing continues any more have ended, and who listens hears of that."""

from collections.abc import Sequence
from dataclasses import replace

from tidemap.services.anomalies import anomaly_of
from tidemap.services.context import Context
from tidemap.services.incidents import EventChange, ended_before
from tidemap.services.messages import publish_events
from tidemap.storage.records import AnomalyRecord, LocationRecord
from tidemap.storage.work import Work


def end_events(ctx: Context, location: LocationRecord, first_stop: float) -> None:
    """Say of the events of a location that have ended that they have; `first_stop`: when the first of them stopped.

    Late data may still continue them, and then they end anew.
    """
    if first_stop >= ended_before(location, ctx.clock()):
        return

    def end(work: Work) -> list[EventChange]:
        before = ended_before(work.locations.lock(location.id), ctx.clock())
        events = work.anomalies.due_to_end(location.id, before)
        return marked(work, [replace(event, ended=True) for event in events])

    ctx.store.write(end, lambda changes: publish_events(ctx, changes))


def marked(work: Work, events: Sequence[AnomalyRecord]) -> list[EventChange]:
    """Store what is said of events beside what they show; what has become of them."""
    return [
        EventChange(anomaly_of(work.locations.by_id(each.location_id), each), "updated")
        for each in work.anomalies.mark(events)
    ]

"""Messages of stored events, and those that somebody has missed."""

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

from tidemap.events.messages import Attention, EventMessage
from tidemap.events.subscription import EventFilter
from tidemap.services.anomalies import Anomaly, changed_events
from tidemap.services.context import Context
from tidemap.services.incidents import EventChange, published
from tidemap.services.listing import shortened

SAID = ("acknowledged_by", "snoozed_by", "snoozed_until")
HIDDEN = ("location_id", "damage", "seen", "marks", "part_of")


def anomaly_message(event: Anomaly, now: float, *, update: bool = False, joined: Sequence[int] = ()) -> EventMessage:
    """The message of an event: in it, what the API shows of the event in a list."""
    news = {"update": update, "joined": list(joined)}
    return EventMessage("anomaly", event.location, event.id, now, _data(shortened(event)) | news)


def publish_events(ctx: Context, changes: Sequence[EventChange]) -> None:
    """Publish what has become of events: `update` says that the event was published before, `joined` which younger
    ones are a part of it from now on."""
    now = ctx.clock()
    for change in published(changes):
        update = change.done == "updated"
        ctx.bus.publish(anomaly_message(change.event, now, update=update, joined=change.joined))


def publish_said(ctx: Context, change: EventChange, what: Attention) -> None:
    """Publish what somebody has said of an event, as a change of it; of one that nobody is to hear of that alone."""
    publish_events(ctx, [change])
    if not change.audible:
        data = {"change": what, **{name: getattr(change.event, name) for name in SAID}}
        ctx.bus.publish(EventMessage("attention", change.event.location, change.event.id, ctx.clock(), data))


def latest_change(ctx: Context) -> int:
    """The number of the latest change of an event, 0 before the first: what changes later has a higher one."""
    with ctx.store.read() as work:
        return work.anomalies.latest()


def missed_changes(ctx: Context, wanted: EventFilter, after: int, limit: int) -> list[EventMessage]:
    """The messages of events that changed after a number, of the locations that are wanted, in order of that.

    Of an event its first message, where that is after the number, and the latest change; both with the event as it is
    now. So a reader that is cut off between the two hears of each event as a new one, and once. What it was joined with
    is not said. Raises LocationNotFoundError.
    """
    return [
        anomaly_message(event, ctx.clock(), update=event.change != event.id)
        for event in changed_events(ctx, wanted.location, wanted.scope, after, limit)
    ]


def _data(event: Anomaly) -> dict[str, Any]:
    values = {each.name: getattr(event, each.name) for each in fields(event) if each.name not in HIDDEN}
    parts = event.parts
    shown = None if parts is None else {name: cells.tolist() for name, cells in parts.items()}
    values |= {"change": event.change or None, "observed": None if event.silent else event.observed}
    return values | {"cells": event.cells.tolist(), "bbox": event.bbox and list(event.bbox), "parts": shown}

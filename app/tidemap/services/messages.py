"""Messages of stored events, and those that somebody has missed."""

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

from tidemap.events.messages import EventMessage
from tidemap.events.subscription import EventFilter
from tidemap.services.anomalies import Anomaly, EventQuery, list_events
from tidemap.services.context import Context
from tidemap.services.incidents import EventChange, published
from tidemap.services.listing import shortened

HIDDEN = ("location_id", "damage", "seen", "marks", "part_of")


def anomaly_message(event: Anomaly, now: float) -> EventMessage:
    """The message of a new event: in it, what the API shows of the event in a list."""
    return EventMessage(
        "anomaly", event.location, event.id, now, _data(shortened(event)) | {"update": False, "joined": []}
    )


def publish_events(ctx: Context, changes: Sequence[EventChange]) -> None:
    """Publish what has become of events: `update` says that the event was published before, `joined` which younger
    ones are a part of it from now on."""
    now = ctx.clock()
    for change in published(changes):
        message = anomaly_message(change.event, now)
        news = {"update": change.done == "updated", "joined": list(change.joined)}
        ctx.bus.publish(replace(message, data=message.data | news))


def latest_anomaly(ctx: Context) -> int:
    """The id of the last stored event, 0 before the first: what is stored later has a higher one."""
    with ctx.store.read() as work:
        return work.anomalies.latest()


def missed_anomalies(ctx: Context, wanted: EventFilter, after: int, limit: int) -> list[EventMessage]:
    """The messages of stored events after an id, of the locations that are wanted, oldest first.

    Raises LocationNotFoundError.
    """
    events = list_events(ctx, EventQuery(location=wanted.location, scope=wanted.scope, after=after, limit=limit))
    return [anomaly_message(event, ctx.clock()) for event in events]


def _data(event: Anomaly) -> dict[str, Any]:
    values = {each.name: getattr(event, each.name) for each in fields(event) if each.name not in HIDDEN}
    parts = event.parts
    shown = None if parts is None else {name: cells.tolist() for name, cells in parts.items()}
    return values | {"cells": event.cells.tolist(), "bbox": event.bbox and list(event.bbox), "parts": shown}

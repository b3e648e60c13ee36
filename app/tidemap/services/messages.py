"""Messages of stored events, and those that somebody has missed."""

from dataclasses import fields
from typing import Any

from tidemap.events.messages import EventMessage
from tidemap.events.subscription import EventFilter
from tidemap.services.anomalies import Anomaly, EventQuery, list_events
from tidemap.services.context import Context
from tidemap.services.listing import shortened

HIDDEN = ("location_id", "damage")


def anomaly_message(event: Anomaly, now: float) -> EventMessage:
    """The message of a stored event: in it, what the API shows of the event in a list."""
    return EventMessage("anomaly", event.location, event.id, now, _data(shortened(event)))


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
    return values | {"cells": event.cells.tolist(), "bbox": event.bbox and list(event.bbox)}

"""Messages of stored events, and those that somebody has missed."""

from dataclasses import fields
from typing import Any

from tidemap.events.messages import EventMessage
from tidemap.services.anomalies import Anomaly, EventQuery, list_events
from tidemap.services.context import Context
from tidemap.services.listing import shortened

HIDDEN = ("location_id", "damage")


def anomaly_message(event: Anomaly, now: float) -> EventMessage:
    """The message of a stored event: in it, what the API shows of the event in a list."""
    return EventMessage("anomaly", event.location, event.id, now, _data(shortened(event)))


def missed_anomalies(ctx: Context, location: str | None, after: int, limit: int) -> list[EventMessage]:
    """The messages of stored events after an id, of one location or all, oldest first.

    Raises LocationNotFoundError.
    """
    events = list_events(ctx, EventQuery(location=location, after=after, limit=limit))
    return [anomaly_message(event, ctx.clock()) for event in events]


def _data(event: Anomaly) -> dict[str, Any]:
    values = {each.name: getattr(event, each.name) for each in fields(event) if each.name not in HIDDEN}
    return values | {"cells": event.cells.tolist(), "bbox": event.bbox and list(event.bbox)}

"""Messages of the bus as services make them, and those that somebody has missed."""

from tidemap.events.messages import EventMessage
from tidemap.schemas.anomalies import Event
from tidemap.services.anomalies import EventQuery, list_events
from tidemap.services.context import Context
from tidemap.services.listing import shortened


def anomaly_message(event: Event, now: float) -> EventMessage:
    """The message of a stored event."""
    return EventMessage("anomaly", event.location, event.id or 0, now, shortened(event).model_dump(mode="json"))


def missed_anomalies(ctx: Context, location: str | None, after: int, limit: int) -> list[EventMessage]:
    """The messages of stored events after an id, of one location or all, oldest first.

    Raises LocationNotFoundError.
    """
    events = list_events(ctx, EventQuery(location=location, after=after, limit=limit))
    return [anomaly_message(event, ctx.clock()) for event in events]

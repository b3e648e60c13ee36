"""Events as the API shows them."""

from tidemap.schemas.anomalies import Event, EventParts
from tidemap.services.anomalies import Anomaly
from tidemap.services.listing import shortened


def event_view(event: Anomaly) -> Event:
    """An event with all of its cells."""
    named = {name: getattr(event, name) for name in Event.model_fields}
    box = None if event.bbox is None else list(event.bbox)
    shown = {"id": event.id or None, "cells": event.cells.tolist(), "bbox": box, "parts": _parts(event)}
    return Event(**(named | shown))


def _parts(event: Anomaly) -> EventParts | None:
    if (parts := event.parts) is None:
        return None
    return EventParts(**{name: cells.tolist() for name, cells in parts.items()})


def listed_view(event: Anomaly) -> Event:
    """An event with so many of its cells as are listed."""
    return event_view(shortened(event))

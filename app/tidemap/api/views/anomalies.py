"""Events as the API shows them."""

from dataclasses import asdict

from tidemap.schemas.anomalies import ConfidenceAnswer, ConfidenceRate, Event, EventDetail, EventParts, EventReasons
from tidemap.services.anomalies import Anomaly
from tidemap.services.confidence import ConfidenceView
from tidemap.services.listing import shortened
from tidemap.services.reasons import Reasons


def event_view(event: Anomaly) -> Event:
    """An event with all of its cells."""
    named = {name: getattr(event, name) for name in Event.model_fields}
    box = None if event.bbox is None else list(event.bbox)
    shown = {"id": event.id or None, "cells": event.cells.tolist(), "bbox": box, "parts": _parts(event)}
    stored = {"change": event.change or None, "observed": None if event.silent else event.observed}
    return Event(**(named | shown | stored))


def detail_view(event: Anomaly, why: Reasons | None) -> EventDetail:
    """An event with its reasons."""
    return EventDetail(**dict(event_view(event)), reasons=None if why is None else EventReasons(**asdict(why)))


def confidence_view(found: ConfidenceView) -> ConfidenceAnswer:
    """The confidence that was found."""
    named = {name: getattr(found, name) for name in ConfidenceAnswer.model_fields}
    return ConfidenceAnswer(**named | {"rates": [ConfidenceRate(**asdict(rate)) for rate in found.rates]})


def _parts(event: Anomaly) -> EventParts | None:
    if (parts := event.parts) is None:
        return None
    return EventParts(**{name: cells.tolist() for name, cells in parts.items()})


def listed_view(event: Anomaly) -> Event:
    """An event with so many of its cells as are listed."""
    return event_view(shortened(event))

"""Events as they are listed, however many and large they are."""

from dataclasses import replace
from heapq import nlargest

from tidemap.services.anomalies import Anomaly

MAX_EVENTS = 100
"""Events in the answer to a post; all of them are stored."""
MAX_CELLS = 10_000
"""Cells of an event in a list; asked for alone, an event has all of them."""


def shortened(event: Anomaly) -> Anomaly:
    """The event with so many of its cells as are listed."""
    if len(event.cells) <= MAX_CELLS:
        return event
    seen = None if event.seen is None else event.seen[:MAX_CELLS]
    return replace(event, cells=event.cells[:MAX_CELLS], seen=seen)


def most_surprising(events: list[Anomaly]) -> list[Anomaly]:
    """So many as are listed: the most surprising, of those the largest, in the order that they had."""
    if len(events) > MAX_EVENTS:
        chosen = nlargest(MAX_EVENTS, range(len(events)), key=lambda i: (events[i].surprise, events[i].cells_total))
        events = [events[i] for i in sorted(chosen)]
    return [shortened(event) for event in events]

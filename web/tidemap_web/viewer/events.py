"""What is abnormal at the moment that is shown, framed in the scene."""

from collections.abc import Iterable
from typing import Final

from tidemap.services.anomalies import Anomaly
from tidemap_web.viewer import colors
from tidemap_web.viewer.painted import PaintedView
from tidemap_web.viewer.scene import Box

MAX_BOXES: Final = 12
"""The largest are framed: more would hide one another."""


def boxes(events: Iterable[Anomaly], shown: PaintedView) -> tuple[Box, ...]:
    """Frames of the events that last at the view's time, the largest first."""
    time, interval_s = shown.view.time, shown.location.interval_s
    lasting = [event for event in events if event.bbox and event.start <= time < event.stop + interval_s]
    largest = sorted(lasting, key=lambda event: -event.cells_total)[:MAX_BOXES]
    return tuple(_box(event) for event in largest)


def _box(event: Anomaly) -> Box:
    cells = "1 cell" if event.cells_total == 1 else f"{event.cells_total:,} cells"
    color = colors.UNEXPECTED if event.observed else colors.MISSING
    seen = "not as expected" if event.seen is not None else "occupied" if event.observed else "free"
    return Box(event.bbox or (), f"{seen} · {cells}", color)

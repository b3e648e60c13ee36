"""Reasons: why an event is one. What was expected, what is usual at that hour, and when it was last like this."""

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta
from zoneinfo import ZoneInfo

import numpy as np

from tidemap.errors import CorruptChunkError, NoModelError
from tidemap.history.history import OCCUPIED, UNOBSERVED
from tidemap.services.anomalies import Anomaly
from tidemap.services.context import Context
from tidemap.services.history import read_cell, window
from tidemap.services.parts import Cells
from tidemap.services.spectra import fitted
from tidemap.spectral.anomaly import surprise
from tidemap.storage.records import SEEN_OCCUPIED, LocationRecord

MAX_CELLS = 1024
"""Cells of an event among which the most surprising is looked for."""
WEEKS = 8
"""How many weeks before an event say what is usual."""
MAX_WEEKS = 26
"""How many weeks back it is looked for when it was last like this."""
HOUR_S = 3600.0


@dataclass(frozen=True, slots=True)
class Reasons:
    """Of the cell that is most surprising at the start of an event, by the model as it is now.

    expected: p then. usual: the share of `samples` readings in which it was occupied at that hour of that weekday, in
    the eight weeks before; None without any. last_like_this: the latest time before, at that hour of that weekday in
    half a year, when it was as it was in the event; None where it never was.
    """

    cell: int
    observed: int
    expected: float | None
    usual: float | None
    samples: int
    last_like_this: float | None


def reasons(ctx: Context, event: Anomaly) -> Reasons | None:
    """Why an event is one; None where its cells cannot be read. Reads up to 26 hours of one cell's history."""
    if not len(event.cells):
        return None
    with ctx.store.read() as work:
        location = work.locations.by_id(event.location_id)
    cell, observed, expected = _most_surprising(ctx, location, event)
    occupied = samples = 0
    last_like_this = None
    for week, (first, states) in enumerate(_weeks_before(ctx, location, cell, event.start)):
        seen = states != UNOBSERVED
        if week < WEEKS:
            occupied, samples = occupied + int((states == OCCUPIED).sum()), samples + int(seen.sum())
        alike = np.flatnonzero(states == observed)
        if alike.size and last_like_this is None:
            last_like_this = float(location.base.time(first + alike[-1]))
        if week + 1 >= WEEKS and last_like_this is not None:
            break
    return Reasons(cell, observed, expected, occupied / samples if samples else None, samples, last_like_this)


def _most_surprising(ctx: Context, location: LocationRecord, event: Anomaly) -> tuple[int, int, float | None]:
    """The cell, how it was seen and what was expected of it, when the event began."""
    cells, bits = event.cells[:MAX_CELLS], event.bits[:MAX_CELLS]
    states = (bits & SEEN_OCCUPIED) > 0
    try:
        p = fitted(ctx, location.name, part=Cells(cells)).predict(event.start, cells)
    except (NoModelError, CorruptChunkError):
        return int(cells[0]), int(states[0]), None
    row = int(np.argmax(np.nan_to_num(surprise(p, states))))
    return int(cells[row]), int(states[row]), None if np.isnan(p[row]) else float(p[row])


def _weeks_before(
    ctx: Context, location: LocationRecord, cell: int, time: float
) -> Iterator[tuple[int, np.ndarray[tuple[int], np.dtype[np.uint8]]]]:
    """The first sample and the states of one cell at the same hour of each week before, the latest first."""
    start, _ = window(ctx, location)
    hour = datetime.fromtimestamp(time, ZoneInfo(location.time_zone)).replace(minute=0, second=0, microsecond=0)
    for week in range(1, MAX_WEEKS + 1):
        begin = (hour - timedelta(weeks=week)).timestamp()
        first, stop = (int(location.base.sample(each)) for each in (begin, begin + HOUR_S))
        if stop < start:
            return
        try:
            yield first, read_cell(ctx, location, cell, first, max(stop, first + 1)).states()[0]
        except CorruptChunkError:
            continue

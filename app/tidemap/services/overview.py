"""Overview: what is known of many locations now, and what is expected of each next."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import CorruptChunkError
from tidemap.services.context import Context
from tidemap.services.given import known_at
from tidemap.services.locations import LocationSummary, summary
from tidemap.services.spectra import Fitted, stored
from tidemap.spectral.prediction import predict_times, verdict
from tidemap.storage.records import LocationRecord, RevisionRecord
from tidemap.storage.repositories.locations import LocationFilter

AROUND_S = 86400.0
STEP_S = 1800.0
LIKELY = 0.5
"""The state is the likelier one, as in the paper's Eq. 3."""


@dataclass(frozen=True, slots=True, eq=False)
class Outlook:
    """One cell around now. probability (n,) at time (n,): every STEP_S from a day before now to a day after, given what
    was read last from then on.

    verdict: 0 free, 1 occupied, 2 uncertain. change: when the likelier state is expected to differ from now's; None
    where that is not within a day. becomes: what it is then.
    """

    probability_now: float
    verdict: int
    time: NDArray[np.float64]
    probability: NDArray[np.float32]
    change: float | None
    becomes: int


@dataclass(frozen=True, slots=True, eq=False)
class OverviewRow:
    """A location; `outlook` is None of grids, and where there is no model or it cannot be read.

    silent_since: when it was heard last (Unix s), of one that has an event of silence; else None.
    """

    location: LocationSummary
    outlook: Outlook | None
    silent_since: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Overview:
    """Some of `total` locations."""

    rows: Sequence[OverviewRow]
    total: int


def overview(ctx: Context, wanted: LocationFilter, offset: int, limit: int) -> Overview:
    """The locations from number `offset` on, `limit` at most."""
    now = ctx.clock()
    with ctx.store.read() as work:
        total = work.locations.count(wanted)
        found = work.locations.page(wanted, offset, limit)
        silent = work.rhythms.silent([record.id for record, _ in found])
        revisions = _held_revisions(ctx, [record for record, _ in found])
        missing = [record.id for record, _ in found if record.revision and record.id not in revisions]
        revisions |= work.spectra.current(missing) if missing else {}
    rows = [
        OverviewRow(
            summary(record, revisions.get(record.id), n_open),
            _outlook(ctx, record, revisions.get(record.id), now),
            silent.get(record.id),
        )
        for record, n_open in found
    ]
    return Overview(rows, total)


def silent_since(ctx: Context, location: LocationRecord) -> float | None:
    """When a location was heard last that has an event of silence, Unix seconds; else None."""
    with ctx.store.read() as work:
        return work.rhythms.silent([location.id]).get(location.id)


def _held_revisions(ctx: Context, records: Sequence[LocationRecord]) -> dict[int, RevisionRecord]:
    """The revisions whose spectra are in the cache: they need not be read."""
    loaded = {each.id: ctx.caches.spectra.held((each.id, None), each.revision) for each in records}
    return {number: value.revision for number, value in loaded.items() if value is not None}


def _outlook(ctx: Context, location: LocationRecord, revision: RevisionRecord | None, now: float) -> Outlook | None:
    if revision is None or location.n_cells > 1:
        return None
    try:
        return outlook(ctx, stored(ctx, location, revision), now)
    except CorruptChunkError:
        return None


def outlook(ctx: Context, model: Fitted, now: float, cell: int = 0) -> Outlook | None:
    """One cell around now; None where it has not been observed. Raises CorruptChunkError."""
    model.check_readable([cell])
    half = round(AROUND_S / STEP_S)
    time = now + STEP_S * np.arange(-half, half + 1, dtype=np.float64)
    cells = np.array([cell])
    p = known_at(ctx, model, cells, now).condition(predict_times(model.spectrum, time, cells), time)[0]
    if np.isnan(p[half]):
        return None
    change = _change(time[half:], p[half:])
    decided = int(verdict(p[half : half + 1], model.location.confidence)[0])
    return Outlook(float(p[half]), decided, time, p, change, int(p[half] <= LIKELY))


def _change(time: NDArray[np.float64], p: NDArray[np.float32]) -> float | None:
    """When p crosses LIKELY first, between the times around it.

    >>> _change(np.array([0.0, 10.0, 20.0]), np.array([0.9, 0.7, 0.3], np.float32))
    15.0
    """
    other = np.flatnonzero((p > LIKELY) != (p[0] > LIKELY))
    if not other.size:
        return None
    after = int(other[0])
    share = (LIKELY - float(p[after - 1])) / (float(p[after]) - float(p[after - 1]))
    return round(float(time[after - 1] + share * (time[after] - time[after - 1])), 3)

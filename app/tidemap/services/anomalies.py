"""Anomalies: stored events, listed and one by one."""

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import refuse_reversed
from tidemap.scope import EVERYWHERE, Scope
from tidemap.services.context import Context
from tidemap.storage.records import SEEN_FREE, SEEN_OCCUPIED, AnomalyRecord, LocationRecord
from tidemap.storage.repositories.anomalies import SILENCE, AnomalyFilter


@dataclass(frozen=True, eq=False, kw_only=True)
class Anomaly(AnomalyRecord):
    """An event with the name of its location. `cells` (n,) ascend, and may be the first of `cells_total`; `bbox` is
    [x0, y0, z0, x1, y1, z1] in metres, None of kind `state`."""

    location: str
    cells_total: int
    bbox: tuple[float, ...] | None

    @property
    def silent(self) -> bool:
        """Whether it is no surprise, but a silence: nothing was measured."""
        return self.rule == SILENCE

    @property
    def parts(self) -> dict[str, NDArray[np.int64]] | None:
        """The cells that were `occupied` and those that were `free`; None where all were as `observed` says."""
        if self.seen is None:
            return None
        bits = {"occupied": SEEN_OCCUPIED, "free": SEEN_FREE}
        return {name: self.cells[(self.seen & bit) > 0] for name, bit in bits.items()}


@dataclass(frozen=True, slots=True)
class EventQuery:
    """Which stored events; None leaves a condition out. Times overlap [start, stop), locations are in `scope`, and
    `search` is in their names."""

    location: str | None = None
    after: int | None = None
    limit: int | None = 100
    start: float | None = None
    stop: float | None = None
    min_surprise: float | None = None
    acknowledged: bool | None = None
    scope: Scope = EVERYWHERE
    search: str = ""
    muted: bool | None = None


def list_events(ctx: Context, query: EventQuery) -> list[Anomaly]:
    """Stored events, oldest first. Raises LocationNotFoundError, InvalidInputError."""
    refuse_reversed(query.start, query.stop)
    with ctx.store.read() as work:
        location = work.locations.get(query.location) if query.location is not None else None
        records = work.anomalies.list(_filter(query, location))
        locations = work.locations.of_ids({record.location_id for record in records})
    return [_known(ctx, locations[record.location_id], record) for record in records]


def newest_events(ctx: Context, query: EventQuery, before: int | None = None) -> list[tuple[LocationRecord, Anomaly]]:
    """Stored events with their locations, newest first, of those with a lower id than `before`.

    Raises LocationNotFoundError, InvalidInputError.
    """
    refuse_reversed(query.start, query.stop)
    with ctx.store.read() as work:
        location = work.locations.get(query.location) if query.location is not None else None
        records = work.anomalies.newest(_filter(query, location), before)
        locations = work.locations.of_ids({record.location_id for record in records})
    return [
        (locations[record.location_id], _known(ctx, locations[record.location_id], record))
        for record in records
        if record.location_id in locations
    ]


def _filter(query: EventQuery, location: LocationRecord | None) -> AnomalyFilter:
    return AnomalyFilter(
        location.id if location else None,
        query.after,
        query.limit,
        query.start,
        query.stop,
        query.min_surprise,
        query.acknowledged,
        query.scope,
        query.search,
        query.muted,
    )


def changed_events(ctx: Context, location: str | None, scope: Scope, after: int, limit: int) -> list[Anomaly]:
    """Events that began or changed after a number, in order of that, of a location or all in scope.

    One that did both is there twice, as it is now: with its first number as `change`, and with its latest. Muted and
    snoozed ones are left out. Raises LocationNotFoundError.
    """
    with ctx.store.read() as work:
        only = None if location is None else work.locations.get(location)
        records = work.anomalies.changed(after, limit, only.id if only else None, scope)
        locations = {each.id: each for each in ([only] if only else work.locations.list() if records else [])}
    return [replace(_known(ctx, locations[record.location_id], record), change=number) for number, record in records]


def get_event(ctx: Context, anomaly_id: int) -> Anomaly:
    """A stored event. Raises AnomalyNotFoundError."""
    with ctx.store.read() as work:
        record = work.anomalies.get(anomaly_id)
        location = work.locations.by_id(record.location_id)
    return _known(ctx, location, record)


def _known(ctx: Context, location: LocationRecord, record: AnomalyRecord) -> Anomaly:
    """A stored event; one whose cells cannot be read has none."""
    if record.damage is not None:
        ctx.damage.found(location.id, record.damage)
    return anomaly_of(location, record)


def anomaly_of(location: LocationRecord, record: AnomalyRecord) -> Anomaly:
    """An event of a location from its row."""
    return Anomaly(
        **{each.name: getattr(record, each.name) for each in fields(AnomalyRecord)},
        location=location.name,
        cells_total=len(record.cells),
        bbox=location.grid.bounding_box(record.cells) if location.grid and len(record.cells) else None,
    )

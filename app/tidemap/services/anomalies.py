"""Anomalies: list and acknowledge stored events."""

from dataclasses import dataclass

from tidemap.errors import refuse_reversed
from tidemap.schemas.anomalies import Event
from tidemap.services.context import Context
from tidemap.storage.records import AnomalyRecord, LocationRecord
from tidemap.storage.repositories.anomalies import AnomalyFilter
from tidemap.storage.work import Work


@dataclass(frozen=True, slots=True)
class EventQuery:
    """Which stored events; None leaves a condition out. Times overlap [start, stop)."""

    location: str | None = None
    after: int | None = None
    limit: int | None = 100
    start: float | None = None
    stop: float | None = None
    min_surprise: float | None = None
    acknowledged: bool | None = None


def list_events(ctx: Context, query: EventQuery) -> list[Event]:
    """Stored events, oldest first. Raises LocationNotFoundError, InvalidInputError."""
    refuse_reversed(query.start, query.stop)
    with ctx.store.read() as work:
        location = work.locations.get(query.location) if query.location is not None else None
        wanted = AnomalyFilter(
            location.id if location else None,
            query.after,
            query.limit,
            query.start,
            query.stop,
            query.min_surprise,
            query.acknowledged,
        )
        records = work.anomalies.list(wanted)
        locations = {each.id: each for each in ([location] if location else work.locations.list())}
    return [_known(ctx, locations[record.location_id], record) for record in records]


def get_event(ctx: Context, anomaly_id: int) -> Event:
    """A stored event. Raises AnomalyNotFoundError."""
    with ctx.store.read() as work:
        record = work.anomalies.get(anomaly_id)
        location = work.locations.by_id(record.location_id)
    return _known(ctx, location, record)


def acknowledge(ctx: Context, anomaly_id: int, by: str, note: str | None) -> Event:
    """Raises AnomalyNotFoundError."""

    def run(work: Work) -> tuple[LocationRecord, AnomalyRecord]:
        record = work.anomalies.acknowledge(anomaly_id, by, ctx.clock(), note)
        return work.locations.by_id(record.location_id), record

    return _known(ctx, *ctx.store.write(run))


def _known(ctx: Context, location: LocationRecord, record: AnomalyRecord) -> Event:
    """A stored event as the API shows it; one whose cells cannot be read is shown without them."""
    if record.damage is not None:
        ctx.damage.found(location.id, record.damage)
    return wire(location, record)


def wire(location: LocationRecord, record: AnomalyRecord) -> Event:
    """An event as the API shows it."""
    box = location.grid.bounding_box(record.cells) if location.grid and len(record.cells) else None
    shared = ("start", "stop", "observed", "probability", "surprise", "confidence", "rule", "revision")
    people = ("acknowledged_by", "acknowledged_at", "note")
    return Event(
        id=record.id or None,
        location=location.name,
        cells=record.cells.tolist(),
        cells_total=len(record.cells),
        bbox=None if box is None else list(box),
        **{field: getattr(record, field) for field in (*shared, *people)},
    )

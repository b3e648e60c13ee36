"""Observe: put posted measurements on the time base, judge them, store them durably, tell the others."""

from dataclasses import dataclass
from functools import cached_property, partial

from app.errors import CorruptChunkError
from app.events.messages import Message
from app.ingest.observation import Body, Target, parse
from app.schemas.anomalies import Event
from app.services.anomalies import judge, wire
from app.services.context import Context
from app.services.spectra import fitted
from app.spectral.measurements import Measurements
from app.storage.blobs import pack_measurements
from app.storage.records import AnomalyRecord, LocationRecord, ObservationRecord
from app.storage.work import Work


@dataclass(frozen=True, slots=True)
class Post:
    """A body with what its sender says about it."""

    body: Body
    source: str | None = None
    idempotency_key: str | None = None


@dataclass(frozen=True, slots=True)
class Observed:
    """What became of a post; events carry their ids."""

    accepted: int
    duplicate: bool
    first_time: float | None
    last_time: float | None
    anomalies: list[Event]
    revision: int


@dataclass(frozen=True, eq=False)
class _Stored:
    place: LocationRecord
    record: ObservationRecord
    number: int
    anomalies: list[AnomalyRecord]

    @cached_property
    def events(self) -> list[Event]:
        """The anomalies as the API shows them."""
        return [wire(self.place, anomaly) for anomaly in self.anomalies]


def observe(ctx: Context, name: str, post: Post) -> Observed:
    """Store a post; returns after its durable commit.

    Raises LocationNotFoundError, UnreadableBodyError, InvalidInputError, UnsupportedMediaTypeError,
    IdempotencyConflictError, BusyError; nothing is stored then.
    """
    with ctx.store.read() as work:
        place = work.locations.get(name)
        if _known(work, place, post):
            return _duplicate(place)
    target = Target(place.kind, place.cells, ctx.clock() + ctx.settings.future_s)
    measurements = parse(post.body, target)
    events = _judged(ctx, place, measurements)
    record = _record(ctx, post, measurements)
    # Told in the order of the commits: who resumes behind the last event it heard of has missed none.
    stored = ctx.store.write(lambda work: _store(work, place, post, record, events), partial(_tell, ctx))
    if stored is None:
        return _duplicate(place)
    return Observed(record.measurements, False, record.first_time, record.last_time, stored.events, place.revision)


def _judged(ctx: Context, place: LocationRecord, measurements: Measurements) -> list[AnomalyRecord]:
    """Without a model nothing is a surprise; that it is damaged does not keep anybody from posting."""
    if not place.revision or not len(measurements):
        return []
    try:
        return judge(ctx, fitted(ctx, place.name), measurements)
    except CorruptChunkError as error:
        ctx.damage.found(place.id, error)
        return []


def _known(work: Work, place: LocationRecord, post: Post) -> bool:
    key = post.idempotency_key
    return key is not None and work.observations.find_duplicate(place, key, post.body.digest)


def _store(
    work: Work, place: LocationRecord, post: Post, record: ObservationRecord, events: list[AnomalyRecord]
) -> _Stored | None:
    """None when the same post was stored meanwhile."""
    if _known(work, place, post):
        return None
    number = work.observations.append(place, record)
    return _Stored(place, record, number, work.anomalies.append(events))


def _record(ctx: Context, post: Post, measurements: Measurements) -> ObservationRecord:
    return ObservationRecord(
        received_at=ctx.clock(),
        source=post.source,
        measurements=len(measurements),
        first_time=float(measurements.time.min()),
        last_time=float(measurements.time.max()),
        idempotency_key=post.idempotency_key,
        body_hash=post.body.digest,
        payload=pack_measurements(measurements),
    )


def _duplicate(place: LocationRecord) -> Observed:
    return Observed(0, True, None, None, [], place.revision)


def _tell(ctx: Context, stored: _Stored | None) -> None:
    if stored is None:
        return
    now, record = ctx.clock(), stored.record
    told = {"measurements": record.measurements, "source": record.source, "last_time": record.last_time}
    ctx.bus.publish(Message("observation", stored.place.name, stored.number, now, told))
    for event in stored.events:
        ctx.bus.publish(anomaly_message(event, now))


def anomaly_message(event: Event, now: float) -> Message:
    """The message of a stored event."""
    return Message("anomaly", event.location, event.id or 0, now, event.model_dump(mode="json"))

"""Observe: put posted measurements on the time base, judge them, store them durably, tell the others."""

from concurrent.futures import Future
from dataclasses import dataclass
from functools import partial

from app.errors import CorruptChunkError
from app.events.messages import Message
from app.ingest.observation import Body, Target, parse
from app.schemas.anomalies import Event
from app.services.anomalies import judge, wire
from app.services.context import Context
from app.services.keys import Claim, confirm
from app.services.listing import shortened
from app.services.spectra import fitted, held
from app.spectral.measurements import Measurements
from app.storage.blobs import pack_measurements
from app.storage.records import AnomalyRecord, LocationRecord, ObservationRecord
from app.storage.work import Work


@dataclass(frozen=True, slots=True)
class Post:
    """A body with what its sender says about it, and who that is where it has not been made sure of yet."""

    body: Body
    source: str | None = None
    idempotency_key: str | None = None
    claim: Claim | None = None


@dataclass(frozen=True, slots=True)
class Observed:
    """What became of a post; events carry their ids. A duplicate has no number of its own."""

    location: str
    number: int
    accepted: int
    duplicate: bool
    first_time: float | None
    last_time: float | None
    anomalies: list[Event]
    revision: int


def observe(ctx: Context, name: str, post: Post) -> Observed:
    """Store a post; returns after its durable commit.

    Raises UnauthorizedError, LocationNotFoundError, UnreadableBodyError, InvalidInputError,
    UnsupportedMediaTypeError, IdempotencyConflictError, BusyError; nothing is stored then.
    """
    return begin(ctx, name, post).result()


def begin(ctx: Context, name: str, post: Post) -> Future[Observed]:
    """Parse and judge a post and queue it; the future has what `observe` returns after the durable commit.

    Raises as `observe`.
    """
    with ctx.store.read() as work:
        if post.claim is not None:
            confirm(ctx, work, post.claim)
        place = work.locations.get(name)
        known = _known(work, place, post)
    if known:
        return _done(_duplicate(place))
    target = Target(place.kind, place.cells, ctx.clock() + ctx.settings.future_s)
    measurements = parse(post.body, target)
    place, events = _judged(ctx, place, measurements)
    record = _record(ctx, post, measurements)
    # Told in the order of the commits: who resumes behind the last event it heard of has missed none.
    return ctx.store.submit(lambda work: _store(work, place, post, record, events), partial(_tell, ctx, record))


def _done(value: Observed) -> Future[Observed]:
    future: Future[Observed] = Future()
    future.set_result(value)
    return future


def _judged(
    ctx: Context, place: LocationRecord, measurements: Measurements
) -> tuple[LocationRecord, list[AnomalyRecord]]:
    """The events among the measurements by the current revision, and the location as it has that.

    Without a model nothing is a surprise; that it is damaged does not keep anybody from posting.
    """
    if not place.revision:
        return place, []
    spectrum = held(ctx, place)
    if spectrum is None:
        try:
            fit = fitted(ctx, place.name)
        except CorruptChunkError as error:
            ctx.damage.found(place.id, error)
            return place, []
        place, spectrum = fit.place, fit.spectrum
    return place, judge(place, spectrum, measurements)


def _known(work: Work, place: LocationRecord, post: Post) -> bool:
    key = post.idempotency_key
    return key is not None and work.observations.find_duplicate(place, key, post.body.digest)


def _store(
    work: Work, place: LocationRecord, post: Post, record: ObservationRecord, events: list[AnomalyRecord]
) -> Observed:
    """Nothing is stored when the same post was stored meanwhile."""
    if _known(work, place, post):
        return _duplicate(place)
    number = work.observations.append(place, record)
    stored = [wire(place, event) for event in work.anomalies.append(events)]
    times = (record.first_time, record.last_time)
    return Observed(place.name, number, record.measurements, False, *times, stored, place.revision)


def _record(ctx: Context, post: Post, measurements: Measurements) -> ObservationRecord:
    return ObservationRecord(
        received_at=ctx.clock(),
        source=post.source,
        measurements=len(measurements),
        first_time=float(measurements.time.min()),
        last_time=float(measurements.time.max()),
        idempotency_key=post.idempotency_key,
        body_hash=post.body.digest if post.idempotency_key is not None else None,
        payload=pack_measurements(measurements),
    )


def _duplicate(place: LocationRecord) -> Observed:
    return Observed(place.name, 0, 0, True, None, None, [], place.revision)


def _tell(ctx: Context, record: ObservationRecord, stored: Observed) -> None:
    if stored.duplicate:
        return
    now = ctx.clock()
    told = {"measurements": record.measurements, "source": record.source, "last_time": record.last_time}
    ctx.bus.publish(Message("observation", stored.location, stored.number, now, told))
    for event in stored.anomalies:
        ctx.bus.publish(anomaly_message(event, now))


def anomaly_message(event: Event, now: float) -> Message:
    """The message of a stored event."""
    return Message("anomaly", event.location, event.id or 0, now, shortened(event).model_dump(mode="json"))

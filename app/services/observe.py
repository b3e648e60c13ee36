"""Observe: put posted measurements on the time base, judge them, store them durably, tell the others."""

from concurrent.futures import Future
from functools import partial

from app.errors import CorruptChunkError, IdempotencyConflictError, TidemapError
from app.events.messages import Message
from app.ingest.observation import Target, parse
from app.schemas.anomalies import Event
from app.services.anomalies import judge
from app.services.context import Context
from app.services.keys import confirm
from app.services.listing import shortened
from app.services.locations import find_location
from app.services.posts import Entry, Observed, Post, store_all
from app.services.spectra import fitted, held
from app.spectral.measurements import Measurements
from app.storage.blobs import pack_measurements
from app.storage.records import AnomalyRecord, LocationRecord, ObservationRecord


def observe(ctx: Context, name: str, post: Post) -> Observed:
    """Store a post; returns after its durable commit.

    Raises UnauthorizedError, LocationNotFoundError, UnreadableBodyError, InvalidInputError,
    UnsupportedMediaTypeError, IdempotencyConflictError, BusyError; nothing is stored then.
    """
    return begin(ctx, name, post).result()


def begin(ctx: Context, name: str, post: Post) -> Future[Observed]:
    """Parse and judge a post and queue it; the future has what `observe` returns after the durable commit.

    Who sent it and whether its key was used is looked up where it is stored. Raises as `observe`.
    """
    try:
        place = ctx.places.get(name, partial(find_location, ctx))
        measurements = parse(post.body, Target(place.kind, place.cells, ctx.clock() + ctx.settings.future_s))
    except TidemapError:
        _refuse(ctx, name, post)
        raise
    place, events = _judged(ctx, place, measurements)
    entry = Entry(place, post, _record(ctx, post, measurements), events)
    # Told in the order of the commits: who resumes behind the last event it heard of has missed none.
    return ctx.store.submit_item(store_all, entry, partial(_tell, ctx, entry.record))


def _refuse(ctx: Context, name: str, post: Post) -> None:
    """Of a post that is wrong, what is to be said before that.

    Raises UnauthorizedError, LocationNotFoundError, IdempotencyConflictError.
    """
    key = post.idempotency_key
    with ctx.store.read() as work:
        if post.claim is not None:
            confirm(work, post.claim)
        place = work.locations.get(name)
        if key is not None and work.observations.digests(place.id, [key]):
            raise IdempotencyConflictError(key)


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
        if fit.place.id != place.id:
            # Another one took its name meanwhile: this post was for one that is gone, as its storing will find.
            return place, []
        place, spectrum = fit.place, fit.spectrum
    return place, judge(place, spectrum, measurements)


def _record(ctx: Context, post: Post, measurements: Measurements) -> ObservationRecord:
    return ObservationRecord(
        received_at=ctx.clock(),
        source=post.source,
        measurements=len(measurements),
        first_time=float(measurements.time[0]),
        last_time=float(measurements.time[-1]),
        idempotency_key=post.idempotency_key,
        body_hash=post.body.digest if post.idempotency_key is not None else None,
        payload=pack_measurements(measurements),
    )


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

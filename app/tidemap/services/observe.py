"""Observe: put posted measurements on the time base, judge them, store them durably, publish them."""

import asyncio
import math
from concurrent.futures import Future
from contextlib import suppress
from functools import partial

import numpy as np

from tidemap.errors import CorruptChunkError, DomainError, IdempotencyConflictError
from tidemap.events.messages import EventMessage
from tidemap.formats import registry
from tidemap.history.combining import ANY
from tidemap.history.history import OCCUPIED
from tidemap.history.measurements import Measurements
from tidemap.ingest.observation import Target, checked
from tidemap.services.context import Context
from tidemap.services.judge import judge
from tidemap.services.keys import confirm
from tidemap.services.locations import find_location
from tidemap.services.messages import publish_events
from tidemap.services.parts import Cells
from tidemap.services.posts import Entry, Observed, Post, store_all
from tidemap.services.spectra import Fitted, fitted, held_fit
from tidemap.storage.blobs import pack_measurements
from tidemap.storage.records import AnomalyRecord, LocationRecord, ObservationRecord

QUICK_BYTES, QUICK_SNAPSHOTS = 4 << 20, 16
"""What a post takes at most that is parsed and judged between commits: memory, and moments in it. Some milliseconds."""


class NotQuickError(Exception):
    """A post was small, but has too many moments, or its model is not in memory any more."""


def observe(ctx: Context, name: str, post: Post) -> Observed:
    """Store a post; returns after its durable commit.

    Raises UnauthorizedError, LocationNotFoundError, UnreadableBodyError, InvalidInputError,
    UnsupportedMediaTypeError, IdempotencyConflictError, BusyError; nothing is stored then.
    """
    return begin(ctx, name, post).result()


async def submit(ctx: Context, name: str, post: Post) -> Observed:
    """As `observe`, without blocking the event loop: quick posts are parsed by the writer, others in `ctx.parsing`."""
    if is_quick(ctx, name, post):
        with suppress(NotQuickError):
            return await asyncio.wrap_future(begin_quick(ctx, name, post))
    begun = await asyncio.wrap_future(ctx.parsing.submit(begin, ctx, name, post))
    return await asyncio.wrap_future(begun)


def begin(ctx: Context, name: str, post: Post) -> Future[Observed]:
    """Parse and judge a post and queue it; the future has what `observe` returns after the durable commit.

    Who sent it and whether its key was used is looked up where it is stored. Raises as `observe`.
    """
    return ctx.store.submit_item(store_all, judged(ctx, post, *parsed(ctx, name, post)), partial(publish, ctx))


def begin_quick(ctx: Context, name: str, post: Post) -> Future[Observed]:
    """Queue a post as it came: the writer parses and judges it with those that came meanwhile.

    The future has what `observe` returns or raises, or NotQuickError: then nothing was stored, and `begin` is for it.
    For posts that are quick as far as can be seen (`is_quick`).
    """
    return ctx.store.submit_deferred(store_all, partial(_quick_entry, ctx, name, post), partial(publish, ctx))


def is_quick(ctx: Context, name: str, post: Post) -> bool:
    """Whether a post is small and what it is judged by is in memory. Costs nothing, as it is asked on the way."""
    if len(post.body.content) * post.body.cost > QUICK_BYTES:
        return False
    location = ctx.caches.locations.lately(name)
    return location is not None and _can_judge(ctx, location)


def _can_judge(ctx: Context, location: LocationRecord) -> bool:
    """Whether nothing has to be read for it."""
    return not location.revision or held_fit(ctx, location) is not None


def _quick_entry(ctx: Context, name: str, post: Post) -> Entry:
    """A post, parsed and judged. Raises NotQuickError, and as `observe`."""
    location, measurements = parsed(ctx, name, post)
    if len(measurements.heads) > QUICK_SNAPSHOTS or not _can_judge(ctx, location):
        raise NotQuickError
    return judged(ctx, post, location, measurements)


def parsed(ctx: Context, name: str, post: Post) -> tuple[LocationRecord, Measurements]:
    """The location of a post and its measurements. Raises as `observe`."""
    try:
        location = ctx.caches.locations.get(name, partial(find_location, ctx))
        columns = registry.read(post.body, location.cells)
        return location, checked(columns, target_of(ctx, location))
    except DomainError:
        refuse(ctx, name, post)
        raise


def target_of(ctx: Context, location: LocationRecord) -> Target:
    """What measurements of a location may be, now."""
    now, settings = ctx.clock(), ctx.settings
    return Target(location.cells, now - settings.past_s, now + settings.future_s)


def judged(ctx: Context, post: Post, location: LocationRecord, measurements: Measurements) -> Entry:
    """What to store of measurements, whatever form they came in: with the events among them.

    Those that are older than the location's `retention` are dropped; where all are, nothing is stored.
    """
    kept = _retained(ctx, location, measurements)
    location, events = _events(ctx, location, kept)
    return Entry(location, post, record_of(ctx, post, kept), events, len(measurements) - len(kept))


def _retained(ctx: Context, location: LocationRecord, measurements: Measurements) -> Measurements:
    """What of measurements, in order, is not too old to be kept."""
    oldest = -math.inf if location.retention_s is None else ctx.clock() - location.retention_s
    if measurements.time[0] >= oldest:
        return measurements
    return measurements.select(slice(int(np.searchsorted(measurements.time, oldest)), None))


def refuse(ctx: Context, name: str, post: Post) -> None:
    """Of a post that is wrong, what is to be said before that.

    Raises UnauthorizedError, LocationNotFoundError, IdempotencyConflictError.
    """
    key = post.idempotency_key
    with ctx.store.read() as work:
        if post.claim is not None:
            confirm(work, post.claim)
        location = work.locations.get(name)
        if key is not None and work.observations.digests(location.id, [key]):
            raise IdempotencyConflictError(key)


def _events(
    ctx: Context, location: LocationRecord, measurements: Measurements
) -> tuple[LocationRecord, list[AnomalyRecord]]:
    """The events among the measurements by the current revision, and the location as it has that.

    Without a model nothing is a surprise; that it is damaged does not keep anybody from posting.
    """
    if not location.revision or not len(measurements):
        return location, []
    loaded = held_fit(ctx, location)
    if loaded is not None:
        return location, judge(Fitted(location, loaded), _decisive(location, measurements))
    try:
        model = fitted(ctx, location.name, part=Cells(measurements.cell))
    except CorruptChunkError as error:
        ctx.damage.found(location.id, error)
        return location, []
    if model.location.id != location.id:
        # Another one took its name meanwhile: this post was for one that is gone, as its storing will find.
        return location, []
    return model.location, judge(model, _decisive(model.location, measurements))


def _decisive(location: LocationRecord, measurements: Measurements) -> Measurements:
    """Those that say by themselves what the state of a sample is; for `any` a free one does not."""
    says = measurements.state == OCCUPIED if location.combine == ANY else measurements.says()
    return measurements if says.all() else measurements.select(says)


def record_of(ctx: Context, post: Post, measurements: Measurements) -> ObservationRecord:
    """What the log holds of a post."""
    return ObservationRecord(
        received_at=ctx.clock(),
        source=post.source,
        measurements=len(measurements),
        first_time=float(measurements.time[0]) if len(measurements) else 0.0,
        last_time=float(measurements.time[-1]) if len(measurements) else 0.0,
        idempotency_key=post.idempotency_key,
        body_hash=post.body.digest if post.idempotency_key is not None else None,
        payload=pack_measurements(measurements),
    )


def publish(ctx: Context, stored: Observed) -> None:
    """Publish a post in the order of the commits: who resumes behind the last event it heard of has missed none."""
    if not stored.accepted:
        return
    now = ctx.clock()
    data = {"measurements": stored.accepted, "source": stored.source, "last_time": stored.last_time}
    ctx.bus.publish(EventMessage("observation", stored.location, stored.number, now, data))
    publish_events(ctx, stored.changes)

"""Scans: store what a sweep saw as one observation, or keep it until its place in the map is known."""

import asyncio
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import asdict, dataclass, replace
from functools import partial
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import CorruptChunkError, DomainError, ScanNotFoundError, ScanSettledError
from tidemap.formats.registry import Body
from tidemap.ingest.registration import RegistrationOutcome
from tidemap.ingest.scan import SentScan
from tidemap.services.context import Context
from tidemap.services.locations import find_location
from tidemap.services.observe import judged, publish, record_of, refuse
from tidemap.services.posts import Entry, Observed, Post, store_all
from tidemap.services.registering import RegisteredScan, TimedScan, register_scan, timed_scan
from tidemap.space.pose import Pose
from tidemap.space.scan import Scan
from tidemap.storage.blobs import pack_scan, unpack_scan
from tidemap.storage.records import LocationRecord, ScanRecord
from tidemap.storage.work import Work


@dataclass(frozen=True, slots=True)
class ScanQuery:
    """Which scans of a location, newest first; None leaves a condition out."""

    registration: str | None = None
    after: int | None = None
    limit: int | None = 100


async def submit_scan(ctx: Context, name: str, post: Post, read: Callable[[], SentScan]) -> Observed:
    """Store a scan that `read` parses; returns after its durable commit, without blocking the event loop.

    Raises UnauthorizedError, LocationNotFoundError, UnreadableBodyError, InvalidInputError,
    UnsupportedMediaTypeError, IdempotencyConflictError, BusyError, and what `read` raises; nothing is stored then.
    """
    begun = await asyncio.wrap_future(ctx.parsing.submit(begin_scan, ctx, name, post, read))
    return await asyncio.wrap_future(begun)


def begin_scan(ctx: Context, name: str, post: Post, read: Callable[[], SentScan]) -> Future[Observed]:
    """Place a scan and queue what it saw; the future has what `submit_scan` returns. Raises as that."""
    try:
        location = ctx.caches.locations.get(name, partial(find_location, ctx))
        registered = register_scan(ctx, location, timed_scan(location, read()))
    except DomainError:
        refuse(ctx, name, post)
        raise
    return ctx.store.submit_item(store_all, _entry(ctx, post, registered), partial(publish, ctx))


def list_scans(ctx: Context, name: str, query: ScanQuery) -> list[ScanRecord]:
    """What became of scans. Raises LocationNotFoundError."""
    with ctx.store.read() as work:
        location = work.locations.get(name)
        return work.scans.list(location.id, query.registration, query.after, query.limit)


def kept_bytes(ctx: Context, name: str, scan_id: int) -> int:
    """Bytes that the points of a scan in quarantine take, packed or not; 0 of one that has left it.

    Raises LocationNotFoundError, ScanNotFoundError.
    """
    with ctx.store.read() as work:
        record = work.scans.listed(work.locations.get(name).id, scan_id)
    if record is None:
        raise ScanNotFoundError(name, scan_id)
    return record.n_bytes


def points_of(ctx: Context, name: str, scan_id: int) -> NDArray[np.float32]:
    """The points (n, 3) of a scan in quarantine, in the sensor's frame.

    Raises LocationNotFoundError, ScanNotFoundError, ScanSettledError, CorruptChunkError.
    """
    location, record = _find(ctx, name, scan_id)
    return _sweep(ctx, location, record).scan.points


def replay_scan(ctx: Context, name: str, scan_id: int) -> Observed:
    """Register a scan in quarantine again, by the model of now; where that succeeds, store what it saw.

    Raises LocationNotFoundError, ScanNotFoundError, ScanSettledError, CorruptChunkError, InvalidInputError, BusyError.
    """
    location, record = _find(ctx, name, scan_id)
    registered = register_scan(ctx, location, _sweep(ctx, location, record))
    post = Post(Body(b"", ""), record.source)
    entry = _entry(ctx, post, registered)
    again = _record(ctx, post, registered)
    settled = replace(again, id=record.id, received_at=record.received_at, idempotency_key=None)
    stored: Observed = ctx.store.write(lambda work: _settle(work, entry, settled), partial(publish, ctx))
    return stored


def _settle(work: Work, entry: Entry, settled: ScanRecord) -> Observed:
    """Store what a scan came to in the end, once."""
    if not work.scans.settle(settled):
        raise ScanSettledError(settled.id, "settled meanwhile")
    if entry.scan is not None and not entry.record.measurements:
        return _observed(entry, settled)
    (stored,) = store_all(work, [replace(entry, scan=None)])
    if isinstance(stored, DomainError):
        raise stored
    settled = replace(settled, observation=stored.number or None)
    work.scans.number(settled)
    return replace(stored, scan=settled)


def _observed(entry: Entry, scan: ScanRecord) -> Observed:
    """The answer where nothing was seen."""
    return Observed(entry.location.name, scan.source, 0, 0, 0, False, None, None, [], entry.location.revision, scan)


def delete_scan(ctx: Context, name: str, scan_id: int) -> None:
    """Drop a scan, with its points; what it saw stays. Raises LocationNotFoundError, ScanNotFoundError."""

    def delete(work: Work) -> None:
        if not work.scans.delete(work.locations.get(name).id, [scan_id]):
            raise ScanNotFoundError(name, scan_id)

    ctx.store.write(delete)


def _find(ctx: Context, name: str, scan_id: int) -> tuple[LocationRecord, ScanRecord]:
    with ctx.store.read() as work:
        location = work.locations.get(name)
        record = work.scans.find(location.id, scan_id)
    if record is None:
        raise ScanNotFoundError(name, scan_id)
    return location, record


def _entry(ctx: Context, post: Post, registered: RegisteredScan) -> Entry:
    """What to store of a scan. One that is too old to be kept leaves nothing."""
    if registered.quarantined:
        entry = Entry(registered.location, post, record_of(ctx, post, registered.seen), [], 0)
    else:
        entry = judged(ctx, post, registered.location, registered.seen)
    return entry if entry.dropped else replace(entry, scan=_record(ctx, post, registered))


def _record(ctx: Context, post: Post, registered: RegisteredScan) -> ScanRecord:
    payload = _packed(registered.sweep) if registered.quarantined else None
    return ScanRecord(
        location_id=registered.location.id,
        id=0,
        observation=None,
        time=registered.sweep.time,
        received_at=ctx.clock(),
        source=post.source,
        verdict=registered.registration.verdict,
        registration=_plain(registered.registration),
        points=len(registered.sweep.scan.points),
        idempotency_key=post.idempotency_key,
        body_hash=None if post.idempotency_key is None else post.body.digest,
        n_bytes=0 if payload is None else max(len(payload), registered.sweep.scan.points.nbytes),
        payload=payload,
    )


def _plain(registration: RegistrationOutcome) -> dict[str, Any]:
    """A registration as JSON."""
    correction, features = registration.correction, registration.features
    return {
        "verdict": registration.verdict,
        "reason": registration.reason,
        "map_from_sensor": registration.map_from_sensor.values,
        "correction": None
        if correction is None
        else {"translation_m": correction[:3].tolist(), "rotation_rad": correction[3:].tolist()},
        "features": None if features is None else asdict(features),
    }


def _packed(sweep: TimedScan) -> bytes:
    scan = sweep.scan
    header = {
        "time": sweep.time,
        "mode": sweep.mode,
        "map_from_sensor": scan.map_from_sensor.matrix.tolist(),
        "covariance": None if scan.covariance is None else scan.covariance.tolist(),
        "max_range_m": None if scan.max_range_m == inf else scan.max_range_m,
        "min_hits": scan.min_hits,
        "flat": scan.flat,
    }
    return pack_scan(scan.points, header)


def _sweep(ctx: Context, location: LocationRecord, record: ScanRecord) -> TimedScan:
    """The inverse of `_packed`. Raises ScanSettledError, CorruptChunkError."""
    if record.payload is None:
        raise ScanSettledError(record.id, record.verdict)
    try:
        points, header = unpack_scan(record.payload, f"points of scan {record.id}")
    except CorruptChunkError as error:
        ctx.damage.found(location.id, error)
        raise
    scan = Scan(
        points=points,
        map_from_sensor=Pose.of(header["map_from_sensor"]),
        covariance=None if header["covariance"] is None else np.array(header["covariance"]),
        max_range_m=inf if header["max_range_m"] is None else header["max_range_m"],
        min_hits=header["min_hits"],
        flat=header["flat"],
    )
    return TimedScan(header["time"], scan, header["mode"])

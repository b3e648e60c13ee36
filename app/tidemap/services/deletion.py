"""Deletion: what was measured in some time is taken out of log and history, all of it or nothing."""

import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import refuse_reversed
from tidemap.history.chunks import Part, by_segment, of_chunk, split
from tidemap.history.erasing import erase_all
from tidemap.history.measurements import Measurements
from tidemap.history.segment import SEGMENT_SAMPLES, Segment, merge
from tidemap.services.anomalies import anomaly_of
from tidemap.services.compaction import replace_log, segment_before, stored_segment, unpack
from tidemap.services.context import Context
from tidemap.services.history import NOTHING
from tidemap.services.incidents import EventChange
from tidemap.services.locations import find_location
from tidemap.services.messages import publish_events
from tidemap.services.owners import Owners
from tidemap.storage.blobs import pack_segment
from tidemap.storage.records import AnomalyRecord, LocationRecord
from tidemap.storage.repositories.segments import SegmentKey
from tidemap.storage.work import Work

log = logging.getLogger(__name__)
EVERY_ROW = 1 << 62
Choose = Callable[[NDArray[np.float64]], NDArray[np.bool_]]


@dataclass(frozen=True, slots=True)
class Deletion:
    """What is to be deleted: measurements in [start, stop) (Unix s), those of one source or of all of them."""

    start: float
    stop: float
    source: str | None = None

    def __post_init__(self) -> None:
        refuse_reversed(self.start, self.stop)

    def within(self, time: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which of some times (n,) are in it."""
        return np.asarray((time >= self.start) & (time < self.stop))


def delete_observations(
    ctx: Context, name: str, what: Deletion, check: Callable[[], None] = lambda: None, by: str = ""
) -> int:
    """Delete measurements; how many that were. Of a compacted sample that is what stands in it, by its time.

    What is kept of scans of that time goes with them, in a transaction of its own behind theirs.
    What is posted meanwhile is not deleted. The model learns of it with its next update. `check` is called between two
    segments; what it raises ends this, and nothing is deleted. A process that ends in the midst of it has deleted all
    or nothing.
    Raises LocationNotFoundError, InvalidInputError where the source cannot be told apart, CorruptChunkError, BusyError.
    """
    location_id = find_location(ctx, name).id
    while (deleted := _delete(ctx, location_id, what, check)) is None:
        pass
    ctx.store.write(lambda work: work.scans.delete_within(location_id, what.start, what.stop, what.source))
    mine = "everybody" if what.source is None else repr(what.source)
    log.info(
        "%d measurements of %s at location %r in [%s, %s) were deleted by %s",
        *(deleted, mine, name, what.start, what.stop, by or "this process"),
    )
    return deleted


def _delete(ctx: Context, location_id: int, what: Deletion, check: Callable[[], None]) -> int | None:
    """One try; None where somebody else has compacted or deleted meanwhile."""
    with ctx.compacting:
        with ctx.store.read() as work:
            location = work.locations.by_id(location_id)
            rows = work.observations.packed(location, EVERY_ROW)
            keys, choose = _reached(work, location, what), _chooser(work, location, what)
        parts, damaged = unpack(ctx, location, rows)
        sources = [row.source for row in rows if row.number not in damaged]
        kept = [_kept(part, source, what) for part, source in zip(parts, sources, strict=True)]
        deleted = sum(map(len, parts)) - sum(map(len, kept))
        merged: dict[SegmentKey, bytes] = {}
        for key, segment, erased in _revised(ctx, location, split([part for part in kept if len(part)]), keys, choose):
            merged[key] = b"" if segment.is_empty else pack_segment(segment)
            deleted += erased
            check()
        through = rows[-1].number if rows else location.compacted_seq

        changes: list[EventChange] = []

        def store(work: Work) -> int | None:
            if not replace_log(work, location, through, merged, damaged):
                return None
            work.observations.recount(location, work.segments.times(location), deleted)
            changes[:] = _without_events(work, location, what)
            return deleted

        def let_go(_: int | None) -> None:
            _let_go(ctx, location_id)
            publish_events(ctx, changes)

        return ctx.store.write(store, let_go) if deleted else 0


def _without_events(work: Work, location: LocationRecord, what: Deletion) -> list[EventChange]:
    """Delete the events that lie in a deleted span, and end others at its border, or begin them there.

    Of what one source measured nobody knows which events came of it: they stay.
    """
    if what.source is not None:
        return []
    work.anomalies.delete_within(location.id, what.start, what.stop)
    cut = [
        replace(event, start=what.stop) if what.start <= event.start else replace(event, stop=what.start)
        for event in work.anomalies.near(location.id, what.start, what.stop)
        if event.damage is None and _reaches_in(event, what)
    ]
    return [EventChange(anomaly_of(location, event), "updated") for event in work.anomalies.change(cut)]


def _reaches_in(event: AnomalyRecord, what: Deletion) -> bool:
    """Whether an event begins or ends, and not both, in a deleted span."""
    return what.start <= event.start < what.stop or what.start < event.stop <= what.stop


def _reached(work: Work, location: LocationRecord, what: Deletion) -> set[SegmentKey]:
    """The segments that may hold some of it."""
    first, last = location.base.sample([what.start, what.stop]).tolist()
    return set(work.segments.keys(location.id, first // SEGMENT_SAMPLES, last // SEGMENT_SAMPLES))


def _chooser(work: Work, location: LocationRecord, what: Deletion) -> Choose:
    """Which times of a segment are to be erased."""
    if what.source is None:
        return what.within
    owners = Owners(work.sources.compacted(location, what.start, what.stop), what.source, location.combine)
    return lambda time: what.within(time) & owners.own(time, what.within(time))


def _kept(part: Measurements, source: str | None, what: Deletion) -> Measurements:
    """What is left of an observation of a source."""
    if what.source not in (None, source):
        return part
    gone = what.within(part.time)
    return part.select(~gone) if gone.any() else part


def _revised(
    ctx: Context, location: LocationRecord, measured: dict[int, list[Part]], keys: set[SegmentKey], choose: Choose
) -> Iterator[tuple[SegmentKey, Segment, int]]:
    """Segments with what was measured, without what `choose` takes of those with these keys; how much was erased."""
    for chunk in sorted({*measured, *(chunk for chunk, _ in keys)}):
        parts = [part.select(slice(first, stop)) for part, first, stop in measured.get(chunk, [])]
        new = dict(by_segment(of_chunk(Measurements.concatenate(parts), chunk), location.base))
        for number in sorted({*new, *(number for owner, number in keys if owner == chunk)}):
            key, before, erased = (chunk, number), None, 0
            with ctx.store.read() as work:
                if key in keys:
                    before = stored_segment(work, location, key)
                else:
                    key, before = segment_before(ctx, work, location, key)
            segment = before or Segment.empty(location.chunk_size(chunk), number)
            if key in keys:
                segment, erased = erase_all(segment, choose, location.base)
            if erased or number in new:
                yield key, merge(segment, new.get(number, NOTHING), location.base, location.combine), erased


def _let_go(ctx: Context, location_id: int) -> None:
    """Forget what is held of a history that is not so any more."""
    ctx.caches.histories.drop(lambda key: isinstance(key, tuple) and key[0] == location_id)
    ctx.caches.tails.drop(lambda key: key == location_id)
    ctx.caches.locations.forget()

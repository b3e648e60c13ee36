"""Compaction: the log's tail becomes segments of the history, and what is older than `retention` is forgotten."""

from collections.abc import Callable, Collection, Iterator, Mapping

import numpy as np

from tidemap.errors import CorruptChunkError
from tidemap.history.chunks import Part, by_segment, of_chunk, split
from tidemap.history.measurements import Measurements
from tidemap.history.segment import Segment, merge
from tidemap.services.context import Context
from tidemap.services.history import span
from tidemap.services.kept import keep_up
from tidemap.storage.blobs import pack_segment
from tidemap.storage.records import LocationRecord
from tidemap.storage.repositories.observations import Packed
from tidemap.storage.repositories.segments import SegmentKey
from tidemap.storage.work import Work

ROUND_MEASUREMENTS = 8_000_000
"""Measurements that one round takes from the log: the more, the fewer times a segment is written anew, and the more
memory."""
LATE = 1.02
"""How many times its location's `retention` old something is that is dropped though nobody posts."""


def compact(ctx: Context, location: LocationRecord, check: Callable[[], None] = lambda: None) -> None:
    """Move the log's tail into segments, round by round, until nothing is left of what was there at the start.

    `check` is called all the time; what it raises ends this, and leaves the log as the last round did.
    """
    with ctx.store.read() as work:
        target = work.locations.by_id(location.id).observation_seq
    while _compact_some(ctx, location.id, target, check):
        pass
    ctx.store.write(lambda work: work.observations.shrink_file())


def forget(ctx: Context, location: LocationRecord) -> None:
    """Drop compacted history that is older than the location's `retention` by the clock."""
    with ctx.store.read() as work:
        location = work.locations.by_id(location.id)
    if location.retention_s is None or location.first_time is None:
        return
    before = int(location.base.sample(ctx.clock() - location.retention_s))
    if before <= span(location)[0]:
        return

    def drop(work: Work) -> None:
        work.segments.forget(location, before)
        work.observations.recount(location, work.segments.times(location))

    with ctx.compacting:
        ctx.store.write(drop)
    ctx.caches.histories.drop(lambda key: isinstance(key, tuple) and key[0] == location.id)


def forget_everywhere(ctx: Context, check: Callable[[], None] = lambda: None) -> None:
    """Drop what is older than its location's `retention`, by a fiftieth at least, where nobody updates any more.

    Every time this rewrites a segment of each chunk, so it is not done for every sample that passes.
    """
    with ctx.store.read() as work:
        locations = work.locations.list()
    now = ctx.clock()
    for location in locations:
        first, retention_s = location.first_time, location.retention_s
        if first is not None and retention_s is not None and first < now - LATE * retention_s:
            compact(ctx, location, check)
            forget(ctx, location)


def _compact_some(ctx: Context, location_id: int, target: int, check: Callable[[], None]) -> bool:
    """One round; whether there may be more to do."""
    # A compaction that is overtaken by another process stores nothing, so no transaction is held for its length.
    with ctx.compacting:
        check()
        with ctx.store.read() as work:
            location = work.locations.by_id(location_id)
            if location.compacted_seq >= target:
                return False
            rows = work.observations.packed(location, ROUND_MEASUREMENTS)
        keep_up(ctx, location)
        through = rows[-1].number
        parts, damaged = unpack(ctx, location, rows)
        del rows
        merged: dict[SegmentKey, bytes] = {}
        for key, payload in _merge_all(ctx, location, split(parts)):
            merged[key] = payload
            check()
        ctx.store.write(lambda work: replace_log(work, location, through, merged, damaged))
    return True


def replace_log(
    work: Work,
    location: LocationRecord,
    through: int,
    segments: Mapping[SegmentKey, bytes],
    damaged: Collection[int] = (),
) -> bool:
    """Put merged segments, packed, in place of the log up to number `through`; damaged observations stay in it.

    False, and nothing done, when somebody else has compacted since `location` was read.
    """
    if not work.observations.settle(location, through, damaged):
        return False
    work.segments.put(location, segments)
    return True


def unpack(ctx: Context, location: LocationRecord, rows: list[Packed]) -> tuple[list[Measurements], set[int]]:
    """What can be read of a part of the log, and the numbers of what cannot, which is reported."""
    parts, damaged = [], set()
    # In two large arrays: hundreds of small ones would leave holes in the heap when they go.
    total = sum(row.measurements for row in rows)
    cell, state = np.empty(total, np.uint32), np.empty(total, np.uint8)
    stop = 0
    for row in rows:
        try:
            part = row.unpack()
        except CorruptChunkError as error:
            ctx.damage.found(location.id, error)
            damaged.add(row.number)
            continue
        start, stop = stop, stop + len(part)
        cell[start:stop], state[start:stop] = part.cell, part.state
        parts.append(Measurements(part.time, cell[start:stop], state[start:stop]))
    return parts, damaged


def _merge_all(
    ctx: Context, location: LocationRecord, measured: dict[int, list[Part]]
) -> Iterator[tuple[SegmentKey, bytes]]:
    """The segments that what was measured in each chunk changes, packed; one at a time is held unpacked."""
    for chunk, parts in sorted(measured.items()):
        whole = Measurements.concatenate([part.select(slice(first, stop)) for part, first, stop in parts])
        for number, new in by_segment(of_chunk(whole, chunk), location.base):
            with ctx.store.read() as work:
                key, before = segment_before(ctx, work, location, (chunk, number))
            segment = before or Segment.empty(location.chunk_size(chunk), number)
            yield key, pack_segment(merge(segment, new, location.base, location.combine))


def stored_segment(work: Work, location: LocationRecord, key: SegmentKey) -> Segment | None:
    """What is stored of a segment, with what was put aside for it. Raises CorruptChunkError."""
    chunk, number = key
    return dict(work.segments.of_chunk(location, chunk, number, number)).get(number)


def segment_before(
    ctx: Context, work: Work, location: LocationRecord, key: SegmentKey
) -> tuple[SegmentKey, Segment | None]:
    """What is stored of a segment, and where; of a damaged one what was put aside for it."""
    chunk, number = key
    try:
        return key, stored_segment(work, location, key)
    except CorruptChunkError as error:
        # Its bytes stay as they are, so that they can be repaired; new data is kept beside them.
        ctx.damage.found(location.id, error)
        return (-1 - chunk, number), work.segments.put_aside(location, chunk, number)

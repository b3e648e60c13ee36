"""The history of locations: reading it (compacted segments and the log's tail together) and compacting the log."""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from app.services.context import Context
from app.spectral.history import History
from app.spectral.measurements import Measurements
from app.spectral.segment import SEGMENT_SAMPLES, Segment, merge
from app.storage.observations import SegmentKey
from app.storage.records import CHUNK_CELLS, LocationRecord
from app.storage.work import Work

COMPACT_MEASUREMENTS = 4_000_000
"""Measurements that one round of compaction takes from the log: what bounds its memory."""


def span(place: LocationRecord) -> tuple[int, int]:
    """Samples [start, stop) from the first to the last measurement; (0, 0) without any."""
    if place.first_time is None or place.last_time is None:
        return 0, 0
    return int(place.base.sample(place.first_time)), int(place.base.sample(place.last_time)) + 1


def window(ctx: Context, place: LocationRecord) -> tuple[int, int]:
    """The part of `span` that is modelled: its latest `max_samples` samples."""
    start, stop = span(place)
    return max(start, stop - ctx.settings.max_samples), stop


def read_history(ctx: Context, name: str, chunk: int, start: int, stop: int) -> History:
    """What was observed in one chunk over samples [start, stop), held where the location says so."""
    with ctx.store.read() as work:
        place = work.locations.get(name)
        held = place.hold_samples
        history = _stored(ctx, work, place, chunk, start - (held or 0), stop)
    if held is not None:
        history = history.hold(held)
    return history.window(start, stop)


def read_known(ctx: Context, name: str, chunk: int, start: int, stop: int) -> History:
    """What was measured in one chunk over samples [start, stop) and, uncopied, in those around them."""
    with ctx.store.read() as work:
        return _stored(ctx, work, work.locations.get(name), chunk, start, stop)


def read_cell(ctx: Context, place: LocationRecord, cell: int, start: int, stop: int) -> History:
    """The history of one cell over samples [start, stop)."""
    return read_history(ctx, place.name, cell // CHUNK_CELLS, start, stop).cells(np.array([cell % CHUNK_CELLS]))


def _stored(ctx: Context, work: Work, place: LocationRecord, chunk: int, start: int, stop: int) -> History:
    """At least [start, stop), in whole segments, but never further than the measurements reach."""
    known_start, known_stop = span(place)
    start, stop = max(start, known_start), min(stop, known_stop)
    if stop <= start:
        return History.empty(place.chunk_size(chunk), start, 0)
    first, last = start // SEGMENT_SAMPLES, (stop - 1) // SEGMENT_SAMPLES
    key = (place.id, chunk, first, last, place.compacted_seq, place.observation_seq)
    return ctx.histories.get(key, partial(_assemble, ctx, work, place, chunk, first, last))


def _assemble(ctx: Context, work: Work, place: LocationRecord, chunk: int, first: int, last: int) -> History:
    segments = work.observations.segments(place, chunk, first, last)
    tail = _tail(ctx, work, place)
    numbers = place.base.sample(tail.time) // SEGMENT_SAMPLES
    mine = (tail.cell // CHUNK_CELLS == chunk) & (numbers >= first) & (numbers <= last)
    for number in np.unique(numbers[mine]).tolist():
        before = segments.get(number) or Segment.empty(place.chunk_size(chunk), number)
        segments[number] = merge(before, _local(tail, mine & (numbers == number)), place.base)
    whole = History.empty(place.chunk_size(chunk), first * SEGMENT_SAMPLES, (last - first + 1) * SEGMENT_SAMPLES)
    for number, segment in segments.items():
        bytes_ = slice((number - first) * SEGMENT_SAMPLES // 8, (number - first + 1) * SEGMENT_SAMPLES // 8)
        whole.observed[:, bytes_] = segment.history.observed
        whole.occupied[:, bytes_] = segment.history.occupied
    return whole


def _tail(ctx: Context, work: Work, place: LocationRecord) -> Measurements:
    key = (place.id, place.compacted_seq, place.observation_seq)
    return ctx.tails.get(key, lambda: Measurements.concatenate([part for _, part in work.observations.tail(place)]))


def _local(measurements: Measurements, rows: NDArray[np.generic]) -> Measurements:
    """Some measurements of one chunk, their cells counted from its first."""
    some = measurements.select(rows)
    return Measurements(some.time, some.cell % np.uint32(CHUNK_CELLS), some.state)


def compact(ctx: Context, name: str) -> None:
    """Move the log's tail into segments, round by round, until nothing is left of what was there at the start."""
    with ctx.store.read() as work:
        target = work.locations.get(name).observation_seq
    while _compact_some(ctx, name, target):
        pass


def forget(ctx: Context, name: str) -> None:
    """Drop compacted history that is older than the location's `retention`."""
    with ctx.store.read() as work:
        place = work.locations.get(name)
    if place.retention_s is None or place.last_time is None:
        return
    before = int(place.base.sample(place.last_time - place.retention_s))
    if before > span(place)[0]:
        ctx.store.write(lambda work: work.observations.forget(place, before))
        ctx.histories.drop(lambda key: isinstance(key, tuple) and key[0] == place.id)


def _compact_some(ctx: Context, name: str, target: int) -> bool:
    """One round; whether there is more to do."""
    with ctx.store.read() as work:
        place = work.locations.get(name)
        if place.compacted_seq >= target:
            return False
        parts = work.observations.tail(place, COMPACT_MEASUREMENTS)
        measurements = Measurements.concatenate([part for _, part in parts])
        merged = _merge_all(work, place, measurements)
    through = parts[-1][0]
    ctx.store.write(lambda work: work.observations.compact(place, through, merged))
    return through < target


def _merge_all(work: Work, place: LocationRecord, measurements: Measurements) -> dict[SegmentKey, Segment]:
    numbers = place.base.sample(measurements.time) // SEGMENT_SAMPLES
    chunks = (measurements.cell // CHUNK_CELLS).astype(np.int64)
    low = int(numbers.min(initial=0))
    width = int(numbers.max(initial=0)) - low + 1
    keys = chunks * width + (numbers - low)
    order = np.argsort(keys, kind="stable")
    bounds = np.flatnonzero(np.diff(keys[order], prepend=-1, append=-1) != 0)
    merged: dict[SegmentKey, Segment] = {}
    for begin, end in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
        chunk, number = divmod(int(keys[order[begin]]), width)
        number += low
        before = work.observations.segments(place, chunk, number, number).get(number)
        segment = before or Segment.empty(place.chunk_size(chunk), number)
        merged[chunk, number] = merge(segment, _local(measurements, order[begin:end]), place.base)
    return merged

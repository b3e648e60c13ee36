"""The history of locations: compacted segments and the log's tail together."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import cast

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import CorruptChunkError
from tidemap.history.chunks import CHUNK_CELLS, by_chunk, by_segment, of_chunk
from tidemap.history.history import History
from tidemap.history.measurements import Measurements
from tidemap.history.segment import SEGMENT_SAMPLES, Segment, ends_of, lay, merge, since_gap, standing, times_at
from tidemap.history.timebase import TimeBase
from tidemap.services.context import Context
from tidemap.settings import YEAR_S
from tidemap.storage.records import LocationRecord
from tidemap.storage.repositories.observations import Tail
from tidemap.storage.work import Work

MIN_BYTES = 5
"""Memory of an unpacked measurement at least: a cell and a state, where all of a post are of one time."""
NOTHING = Measurements.concatenate([])
CHUNK_BITS = 1 << 27
"""Cells times samples of a chunk that are held at once: one measurement of 1970 must not fill the memory."""


def span(location: LocationRecord) -> tuple[int, int]:
    """Samples [start, stop) from the first to the last measurement; (0, 0) without any."""
    if location.first_time is None or location.last_time is None:
        return 0, 0
    return _samples(location.base, location.first_time, location.last_time)


@lru_cache
def _samples(base: TimeBase, first: float, last: float) -> tuple[int, int]:
    """Kept, as every chunk of a large map asks for it."""
    return int(base.sample(first)), int(base.sample(last)) + 1


def window(ctx: Context, location: LocationRecord) -> tuple[int, int]:
    """The samples that are modelled: of `span`, and of what is held after it until now, the latest `max_samples`.

    Fewer where a chunk would be too large. What was seen before a gap of a year is left out where no more was seen
    before it than since, as a reading of a clock that was wrong.
    """
    start, stop = span(location)
    if stop > start and location.hold_samples is not None:
        now = int(location.base.sample(ctx.clock())) + 1
        stop = max(stop, min(stop + location.hold_samples, now))
    most = min(ctx.settings.max_samples, CHUNK_BITS // min(location.n_cells, CHUNK_CELLS))
    start = max(start, stop - most)
    if (stop - start) * location.interval_s <= YEAR_S:
        return start, stop
    return max(start, since_gap(_populated(ctx, location), YEAR_S / location.interval_s) * SEGMENT_SAMPLES), stop


def _populated(ctx: Context, location: LocationRecord) -> list[int]:
    """The segments in which something was seen, ascending."""
    with ctx.store.read() as work:
        compacted = work.segments.numbers(location.id)
        ends = np.array(work.observations.pending_times(location), np.float64).reshape(-1)
    return sorted({*compacted, *(location.base.sample(ends) // SEGMENT_SAMPLES).tolist()})


def read_history(ctx: Context, location: LocationRecord, chunk: int, start: int, stop: int) -> History:
    """What was observed in one chunk until now over samples [start, stop), held where the location says so."""
    with ctx.store.read() as work:
        location = work.locations.by_id(location.id)
        history = _stored(ctx, work, location, chunk, start - (location.hold_samples or 0), stop)
    return _held(location, history, start, stop)


def read_measured(ctx: Context, location: LocationRecord, chunk: int, start: int, stop: int) -> History:
    """As `read_history`, without what is held."""
    with ctx.store.read() as work:
        location = work.locations.by_id(location.id)
        return _stored(ctx, work, location, chunk, start, stop).window(start, stop)


def read_compacted(ctx: Context, location: LocationRecord, chunk: int, start: int, stop: int) -> History:
    """The same of what is compacted alone, which nobody's posts change meanwhile; nothing of it is kept for others.

    Held where `location` says so, whatever is stored of it by now.
    """
    with ctx.store.read() as work:
        stored = work.locations.by_id(location.id)
        settled = replace(stored, observation_seq=stored.compacted_seq)
        try:
            history = _whole(ctx, work, settled, chunk, start - (location.hold_samples or 0), stop)
        except CorruptChunkError as error:
            ctx.damage.found(location.id, error)
            raise
    return _held(location, history, start, stop)


def _held(location: LocationRecord, history: History, start: int, stop: int) -> History:
    """Samples [start, stop), a state held until the next measurement where the location says so."""
    if location.hold_samples is None:
        return history.window(start, stop)
    return history.held(start, stop, location.hold_samples)


def read_cell(ctx: Context, location: LocationRecord, cell: int, start: int, stop: int) -> History:
    """The history of one cell over samples [start, stop)."""
    return read_history(ctx, location, cell // CHUNK_CELLS, start, stop).cells(np.array([cell % CHUNK_CELLS]))


def read_measurements(ctx: Context, location: LocationRecord, cell: int, start: int, stop: int) -> Measurements:
    """What stands of the measurements of one cell in samples [start, stop), at their exact times, in order of time.

    Unpacks the segments of its chunk. Raises CorruptChunkError.
    """
    chunk, row = divmod(cell, CHUNK_CELLS)
    with ctx.store.read() as work:
        location = work.locations.by_id(location.id)
        segments = _merged(ctx, work, location, chunk, *_segments(location, start, stop))
        found = Measurements.concatenate([standing(_one_cell(each, row), location.base) for each in segments])
    sample = found.samples(location.base)
    return found.select((sample >= start) & (sample < stop)).in_order()


def _one_cell(segment: Segment, row: int) -> Segment:
    rank = None if segment.rank is None else segment.rank[row : row + 1]
    return Segment(segment.history.cells([row]), segment.time, rank)


@dataclass(frozen=True, slots=True, eq=False)
class HistoryReader:
    """What was measured in the chunks of a location, in one moment of the database; samples [first, last) of it."""

    ctx: Context
    work: Work
    location: LocationRecord
    samples: tuple[int, int]

    def backwards(self, chunk: int, sample: int) -> Iterator[History]:
        """In one chunk at or before `sample`, segment by segment, the latest first; a segment is whole, so it may hold
        more. Raises CorruptChunkError."""
        for begin, end in _backwards(self.samples, sample):
            yield _stored(self.ctx, self.work, self.location, chunk, begin, end)


@contextmanager
def reading(ctx: Context, location: LocationRecord) -> Iterator[HistoryReader]:
    """For some chunks at a time: meanwhile the database keeps what is replaced."""
    samples = window(ctx, location)
    with ctx.store.read() as work:
        yield HistoryReader(ctx, work, work.locations.by_id(location.id), samples)


def read_backwards(ctx: Context, location: LocationRecord, chunk: int, sample: int) -> Iterator[History]:
    """As `HistoryReader.backwards`, every segment as it is when it is asked for."""
    for begin, end in _backwards(window(ctx, location), sample):
        with ctx.store.read() as work:
            piece = _stored(ctx, work, work.locations.by_id(location.id), chunk, begin, end)
        yield piece


def _backwards(samples: tuple[int, int], sample: int) -> Iterator[tuple[int, int]]:
    """The parts of segments at or before a sample, the latest first."""
    start, stop = samples
    end = min(sample + 1, stop)
    while end > start:
        begin = max(start, (end - 1) // SEGMENT_SAMPLES * SEGMENT_SAMPLES)
        yield begin, end
        end = begin


def read_times(ctx: Context, location: LocationRecord, chunk: int, sample: int) -> NDArray[np.float64]:
    """When the cells of one chunk were read in one sample, NaN where they were not. Raises CorruptChunkError."""
    number = sample // SEGMENT_SAMPLES
    with ctx.store.read() as work:
        location = work.locations.by_id(location.id)
        segment = next(_merged(ctx, work, location, chunk, number, number), None)
    return times_at(segment or Segment.empty(location.chunk_size(chunk), number), sample, location.base)


def _stored(ctx: Context, work: Work, location: LocationRecord, chunk: int, start: int, stop: int) -> History:
    """As `_whole`, kept for the next that asks."""
    first, last = _segments(location, start, stop)
    if last < first:
        return _whole(ctx, work, location, chunk, start, stop)
    version = (location.compacted_seq, location.observation_seq, location.deleted)
    load = partial(_whole, ctx, work, location, chunk, start, stop)
    try:
        return ctx.caches.histories.get((location.id, chunk, first, last), version, load)
    except CorruptChunkError as error:
        ctx.damage.found(location.id, error)
        raise


def _whole(ctx: Context, work: Work, location: LocationRecord, chunk: int, start: int, stop: int) -> History:
    """At least [start, stop), in whole segments, but never further than the measurements reach."""
    first, last = _segments(location, start, stop)
    if last < first:
        return History.empty(location.chunk_size(chunk), max(start, span(location)[0]), 0)
    return _assemble(ctx, work, location, chunk, first, last)


def _segments(location: LocationRecord, start: int, stop: int) -> tuple[int, int]:
    """The first and the last segment with measurements of samples [start, stop); without any the last is before it."""
    known_start, known_stop = span(location)
    start, stop = max(start, known_start), min(stop, known_stop)
    first = start // SEGMENT_SAMPLES
    return first, (stop - 1) // SEGMENT_SAMPLES if stop > start else first - 1


def _assemble(ctx: Context, work: Work, location: LocationRecord, chunk: int, first: int, last: int) -> History:
    segments = list(_merged(ctx, work, location, chunk, first, last)) if first == last else ()
    if segments and segments[0].ends is None:
        return segments[0].history
    whole = History.empty(location.chunk_size(chunk), first * SEGMENT_SAMPLES, (last - first + 1) * SEGMENT_SAMPLES)
    ended = []
    for segment in segments or _merged(ctx, work, location, chunk, first, last):
        lay(whole, segment)
        if segment.ends is not None:
            ended.append(ends_of(segment, location.base))
    if not ended:
        return whole
    cell, sample = (np.concatenate(column) for column in zip(*ended, strict=True))
    return whole.ending(cell, sample)


def _merged(ctx: Context, work: Work, location: LocationRecord, chunk: int, first: int, last: int) -> Iterator[Segment]:
    """The segments of a chunk with numbers in [first, last], what is not compacted yet in them; in no order."""
    new = dict(by_segment(_tail(ctx, work, location, chunk), location.base))
    for number, segment in work.segments.of_chunk(location, chunk, first, last):
        yield merge(segment, new.pop(number, NOTHING), location.base, location.combine)
    for number, measured in new.items():
        if first <= number <= last:
            empty = Segment.empty(location.chunk_size(chunk), number)
            yield merge(empty, measured, location.base, location.combine)


def _tail(ctx: Context, work: Work, location: LocationRecord, chunk: int) -> Measurements:
    """What is not compacted yet of one chunk, its cells counted from its first."""
    if location.observation_seq == location.compacted_seq:
        # Nothing, or the caller wants the compacted part alone, and others hold the tail.
        _let_go(ctx, location)
        return NOTHING
    tail = ctx.caches.tails.held(location.id, _version(location))
    if tail is None:
        tail = _read_on(ctx, work, location) or _read_chunk(work, location, chunk)
        _report(ctx, location, tail)
    return Measurements.concatenate([of_chunk(part, chunk) for _, part in tail.parts])


def _let_go(ctx: Context, location: LocationRecord) -> None:
    """Forget what is held of a tail, where all of it is compacted."""
    known = ctx.caches.tails.latest(location.id)
    if known is not None and cast(tuple[int, int], known[0])[1] <= location.compacted_seq:
        ctx.caches.tails.drop(lambda key: key == location.id)


def _version(location: LocationRecord) -> tuple[int, int]:
    """A tail begins after the first of these observations and ends with the second."""
    return location.compacted_seq, location.observation_seq


def _read_on(ctx: Context, work: Work, location: LocationRecord) -> Tail | None:
    """The whole tail, every part sorted by chunk, kept for other chunks and later questions: of an earlier one what is
    held, and what has come in since. None where it is too long to be held: unpacked it would only take memory."""
    if not ctx.caches.tails.takes(work.observations.pending(location) * MIN_BYTES):
        return None
    # One at a time: the others need not read what the first has read, nor hold as much at once.
    with ctx.caches.reading_on:
        parts, since = _known(ctx, location)
        new = work.observations.tail(replace(location, compacted_seq=since), choose=by_chunk)
        return ctx.caches.tails.get(location.id, _version(location), lambda: Tail(parts + new.parts, new.damage))


def _known(ctx: Context, location: LocationRecord) -> tuple[list[tuple[int, Measurements]], int]:
    """What is held of a tail, of this moment or another, and through which observation."""
    known = ctx.caches.tails.latest(location.id)
    if known is not None:
        (compacted, through), held = cast(tuple[int, int], known[0]), known[1]
        if compacted <= location.compacted_seq <= through:
            first, last = _version(location)
            return [part for part in held.parts if first < part[0] <= last], min(through, last)
    return [], location.compacted_seq


def _read_chunk(work: Work, location: LocationRecord, chunk: int) -> Tail:
    """What a tail holds of one chunk; nothing is kept."""
    first, stop = chunk * CHUNK_CELLS, (chunk + 1) * CHUNK_CELLS
    return work.observations.tail(location, choose=lambda part: part.select((part.cell >= first) & (part.cell < stop)))


def _report(ctx: Context, location: LocationRecord, tail: Tail) -> None:
    for error in tail.damage.values():
        ctx.damage.found(location.id, error)

"""Density: how much was observed when, counted in equal steps of a stretch of time."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import refuse_reversed
from tidemap.history.chunks import CHUNK_CELLS
from tidemap.history.measurements import Measurements
from tidemap.history.segment import SEGMENT_SAMPLES
from tidemap.services.context import Context
from tidemap.services.history import span
from tidemap.storage.records import LocationRecord

MAX_BINS = 1000
DEFAULT_BINS = 200
MAX_BLOBS = 2048
"""Segments of chunks that one answer reads, unless each of the samples has its own: of more, chunks are left out."""
Counts = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class DensityQuery:
    """Over [start, stop), by default all that was observed, in `bins` steps at most."""

    start: float | None = None
    stop: float | None = None
    bins: int = DEFAULT_BINS


@dataclass(frozen=True, slots=True, eq=False)
class Density:
    """Counts of the steps [time, time + step_s), of whole samples from the one that contains the start: (n,) each.

    measurements: of all cells, one a sample where history has them by now, as they came where it has not.
    samples: those in which any cell was observed, `step_samples` at most. n_counted: the cells that were counted,
    which are fewer than there are where the map is very large: chunks of them at equal distances stand for all.
    """

    time: NDArray[np.float64]
    step_s: float
    step_samples: int
    measurements: Counts
    samples: Counts
    n_counted: int


def density(ctx: Context, location: LocationRecord, query: DensityQuery, check: Callable[[], None]) -> Density:
    """`check` is called between two segments. What cannot be read is not counted. Raises InvalidInputError."""
    first, last = _samples(location, query)
    step = max(1, -(-(last - first) // query.bins))
    n = -(-(last - first) // step)
    measurements, samples = np.zeros(n, np.int64), np.zeros(n, np.int64)
    stride = 1
    if n:
        numbers, stride, pending = _plan(ctx, location, first, last)
        for number in numbers:
            check()
            counts = pending.get(number, 0) + _compacted(ctx, location, number, stride)
            begin = number * SEGMENT_SAMPLES
            inside = slice(max(first - begin, 0), min(last - begin, SEGMENT_SAMPLES))
            at = (np.arange(begin, begin + SEGMENT_SAMPLES)[inside] - first) // step
            np.add.at(measurements, at, counts[inside])
            np.add.at(samples, at, counts[inside] > 0)
    time = location.base.time(first + step * np.arange(n))
    return Density(time, step * location.interval_s, step, measurements, samples, _n_cells(location, stride))


def _samples(location: LocationRecord, query: DensityQuery) -> tuple[int, int]:
    """The samples [first, last) of a question, none where nothing was observed."""
    first, last = span(location)
    if query.start is not None and query.stop is not None:
        refuse_reversed(query.start, query.stop)
    if first == last:
        return 0, 0
    start = first if query.start is None else int(location.base.sample(query.start))
    stop = last if query.stop is None else int(np.ceil((query.stop - location.epoch) / location.interval_s))
    return start, max(start, stop)


def _plan(ctx: Context, location: LocationRecord, first: int, last: int) -> tuple[list[int], int, dict[int, Counts]]:
    """The segments with anything in samples [first, last), every how manieth chunk is read, and what is pending."""
    low, high = first // SEGMENT_SAMPLES, (last - 1) // SEGMENT_SAMPLES
    with ctx.store.read() as work:
        compacted = [number for number in work.segments.numbers(location.id) if low <= number <= high]
        stride = max(1, -(-location.n_chunks * len(compacted) // MAX_BLOBS))
        stride = min(stride, location.n_chunks)
        between = location.base.time(first), location.base.time(last)
        pending = _pending(location, work.observations.pending_between(location, *map(float, between)), stride)
    return sorted({*compacted, *(number for number in pending if low <= number <= high)}), stride, pending


def _pending(location: LocationRecord, posts: Iterator[Measurements], stride: int) -> dict[int, Counts]:
    """What is not compacted yet of every `stride`th chunk: how often each sample was observed, by segment."""
    counts: dict[int, Counts] = {}
    for post in posts:
        counted = post.select(post.cell // np.uint32(CHUNK_CELLS) % np.uint32(stride) == 0) if stride > 1 else post
        number, sample = np.divmod(counted.samples(location.base), SEGMENT_SAMPLES)
        for each in np.unique(number).tolist():
            found = np.bincount(sample[number == each], minlength=SEGMENT_SAMPLES)
            counts[each] = counts.get(each, 0) + found
    return counts


def _compacted(ctx: Context, location: LocationRecord, number: int, stride: int) -> Counts:
    with ctx.store.read() as work:
        return work.segments.counts(location, number, stride)


def _n_cells(location: LocationRecord, stride: int) -> int:
    return sum(location.chunk_size(chunk) for chunk in range(0, location.n_chunks, stride))

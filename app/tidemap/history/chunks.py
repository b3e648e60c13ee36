"""Chunks: the cells of a location in groups, and what was measured by chunk and by segment."""

from bisect import bisect_left
from collections.abc import Iterator
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from tidemap.history.measurements import Measurements
from tidemap.history.segment import SEGMENT_SAMPLES
from tidemap.history.timebase import TimeBase

CHUNK_CELLS = 1024
"""Cells that are stored, read and fitted together."""
Part: TypeAlias = tuple[Measurements, int, int]
"""Rows [first, stop) of measurements: as measurements of their own they would take half as much memory again."""


def by_chunk(part: Measurements) -> Measurements:
    """The same sorted by chunk and within it as they were; a snapshot is so already."""
    chunks = part.cell // np.uint32(CHUNK_CELLS)
    return part if (chunks[1:] >= chunks[:-1]).all() else part.select(np.argsort(chunks, kind="stable"))


def of_chunk(sorted_: Measurements, chunk: int) -> Measurements:
    """Those of one chunk, their cells counted from its first."""
    first = chunk * CHUNK_CELLS
    # The cells are not sorted, but on which side of a chunk's border they lie is. Numpy's search would let go of the
    # interpreter, and wait for its turn again in every part of a long tail.
    some = sorted_.select(slice(bisect_left(sorted_.cell, first), bisect_left(sorted_.cell, first + CHUNK_CELLS)))
    return Measurements(some.time, some.cell - np.uint32(first), some.state)


def split(parts: list[Measurements]) -> dict[int, list[Part]]:
    """Which part of what was measured at once lies in each chunk; nothing is copied, a log is larger than its rows."""
    found: dict[int, list[Part]] = {}
    for part in map(by_chunk, parts):
        chunk = part.cell // np.uint32(CHUNK_CELLS)
        borders = [0, *(np.flatnonzero(chunk[1:] != chunk[:-1]) + 1).tolist(), len(part)]
        for first, stop in pairwise(borders):
            found.setdefault(int(chunk[first]), []).append((part, first, stop))
    return found


def by_segment(measurements: Measurements, base: TimeBase) -> Iterator[tuple[int, Measurements]]:
    """The measurements of each segment, by its number."""
    if not len(measurements):
        return
    numbers = measurements.samples(base) // SEGMENT_SAMPLES
    if numbers.min() == numbers.max():
        yield int(numbers[0]), measurements
        return
    for number in np.unique(numbers).tolist():
        yield number, measurements.select(numbers == number)

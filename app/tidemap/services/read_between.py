"""Readings between: which cells were read meanwhile, as a writer sees it, with what it has just stored."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import CorruptChunkError
from tidemap.history.chunks import CHUNK_CELLS
from tidemap.history.history import UNOBSERVED
from tidemap.history.segment import SEGMENT_SAMPLES
from tidemap.storage.records import LocationRecord
from tidemap.storage.work import Work

Cells = NDArray[np.int64]
Samples = NDArray[np.int64]

STEP_BITS = 38
"""As many cells as a location may have leave so many bits for samples, eight years of milliseconds."""


def read_between(
    work: Work, location: LocationRecord, cell: Cells, after: Samples, before: Samples
) -> NDArray[np.bool_]:
    """(n,) whether each cell was read in a sample between two others. Damaged readings are left out."""
    if not len(cell):
        return np.zeros(0, np.bool_)
    cells, start, stop = np.unique(cell), int(after.min()) + 1, int(before.max())
    found = [*_pending(work, location, cells, start, stop), *_compacted(work, location, cells, start, stop)]
    read = np.unique(np.concatenate([_keys(each, sample - start) for each, sample in found]))
    low, high = _keys(cell, after + 1 - start), _keys(cell, before - start)
    return np.asarray(np.searchsorted(read, low) < np.searchsorted(read, high))


def _keys(cell: Cells, step: Samples) -> NDArray[np.int64]:
    """In order of cell and sample; step 0 is the first sample."""
    return (cell << STEP_BITS) + step


def _pending(
    work: Work, location: LocationRecord, cells: Cells, start: int, stop: int
) -> Iterator[tuple[Cells, Samples]]:
    """Those that are not compacted yet."""
    yield np.empty(0, np.int64), np.empty(0, np.int64)
    ends = float(location.base.time(start)), float(location.base.time(stop))
    for measurements in work.observations.pending_between(location, *ends):
        sample = measurements.samples(location.base)
        rows = (sample >= start) & (sample < stop) & np.isin(measurements.cell, cells)
        yield measurements.cell[rows].astype(np.int64), sample[rows]


def _compacted(
    work: Work, location: LocationRecord, cells: Cells, start: int, stop: int
) -> Iterator[tuple[Cells, Samples]]:
    """Those that are."""
    ends = start // SEGMENT_SAMPLES, (stop - 1) // SEGMENT_SAMPLES
    for chunk in np.unique(cells // CHUNK_CELLS).tolist():
        mine = cells[cells // CHUNK_CELLS == chunk]
        try:
            for _, segment in work.segments.of_chunk(location, chunk, *ends):
                states = segment.history.cells(mine - chunk * CHUNK_CELLS).window(start, stop).states()
                row, column = np.nonzero(states != UNOBSERVED)
                yield mine[row], start + column
        except CorruptChunkError:
            continue

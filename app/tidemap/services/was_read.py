"""What was read, as a writer's transaction sees it: with what it has just stored."""

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import CorruptChunkError
from tidemap.history.chunks import CHUNK_CELLS
from tidemap.history.segment import SEGMENT_SAMPLES
from tidemap.space.regions import Array
from tidemap.storage.records import LocationRecord
from tidemap.storage.work import Work

STEP_BITS = 35
"""As many cells as a location may have (2^28) leave so many bits for samples, a year of milliseconds."""


def was_read(work: Work, location: LocationRecord, cell: Array, sample: Array) -> NDArray[np.bool_]:
    """(n,) whether each cell was read in the sample beside it; by what can be read of log and history."""
    return _in_log(work, location, cell, sample) | _in_history(work, location, cell, sample)


def _in_log(work: Work, location: LocationRecord, cell: Array, sample: Array) -> NDArray[np.bool_]:
    """Whether it was, and that is not compacted yet."""
    start, stop = int(sample.min()), int(sample.max()) + 1
    ends = float(location.base.time(start)), float(location.base.time(stop))
    found = np.zeros(len(cell), np.bool_)
    wanted = (cell << STEP_BITS) + sample - start
    for measurements in work.observations.pending_between(location, *ends):
        step = measurements.samples(location.base) - start
        rows = (step >= 0) & (step < stop - start) & measurements.says()
        found |= np.isin(wanted, (measurements.cell[rows].astype(np.int64) << STEP_BITS) + step[rows])
    return found


def _in_history(work: Work, location: LocationRecord, cell: Array, sample: Array) -> NDArray[np.bool_]:
    """Whether it was, and that is compacted."""
    found = np.zeros(len(cell), np.bool_)
    numbers = sample // SEGMENT_SAMPLES
    for chunk in np.unique(cell // CHUNK_CELLS).tolist():
        mine = cell // CHUNK_CELLS == chunk
        try:
            for number, segment in work.segments.of_chunk(
                location, chunk, int(numbers[mine].min()), int(numbers[mine].max())
            ):
                rows = np.flatnonzero(mine & (numbers == number))
                found[rows] = segment.history.observed_at(cell[rows] % CHUNK_CELLS, sample[rows])
        except CorruptChunkError:
            continue
    return found

"""Grouping: surprising measurements make events, of neighbours at one time and of what continues them."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tidemap.space.regions import Spans, WasRead, label_regions, link
from tidemap.spectral.anomaly import Rule, surprise
from tidemap.storage.records import SEEN_FREE, SEEN_OCCUPIED, AnomalyRecord, LocationRecord


@dataclass(frozen=True, slots=True, eq=False)
class Marks:
    """Surprising measurements, distinct in (sample, cell); (n,) each."""

    sample: NDArray[np.int64]
    cell: NDArray[np.int64]
    state: NDArray[np.uint8]
    probability: NDArray[np.float32]

    def select(self, rows: NDArray[np.generic]) -> "Marks":
        """Some of them."""
        return Marks(self.sample[rows], self.cell[rows], self.state[rows], self.probability[rows])


@dataclass(frozen=True, slots=True)
class Criterion:
    """What counts as an anomaly, and the revision it was judged by."""

    confidence: float
    rule: Rule
    revision: int


def group(
    location: LocationRecord, marks: Marks, criterion: Criterion, gap: int = 0, was_read: WasRead | None = None
) -> list[AnomalyRecord]:
    """The events, in order of their start.

    Neighbouring marks of one sample belong together, whatever their states, where they are at least `min_cells`; and
    what continues them after at most `gap` samples without a reading of it: see `link`.
    """
    least = min(location.min_cells, location.n_cells)
    if len(marks.cell) < least:
        return []
    label = label_regions(location.cells, marks.sample, marks.cell)
    large = np.bincount(label)[label] >= least
    if not large.any():
        return []
    marks, (regions, label) = marks.select(large), np.unique(label[large], return_inverse=True)
    if marks.sample.min() != marks.sample.max():
        sample = np.empty(len(regions), np.int64)
        sample[label] = marks.sample
        label = link(Spans(label, marks.cell, marks.state, sample, sample), gap, was_read)[label]
    return _events(location, label, marks, criterion)


def _events(
    location: LocationRecord, label: NDArray[np.int64], marks: Marks, criterion: Criterion
) -> list[AnomalyRecord]:
    """One event of the marks of each label."""
    rows = np.lexsort((marks.cell, label))
    label, marks = label[rows], marks.select(rows)
    begin = np.flatnonzero(np.diff(label, prepend=-1))
    head = np.flatnonzero((np.diff(label, prepend=-1) != 0) | (np.diff(marks.cell, prepend=-1) != 0))
    seen = np.bitwise_or.reduceat(np.where(marks.state, SEEN_OCCUPIED, SEEN_FREE).astype(np.uint8), head)
    borders = np.searchsorted(head, begin)
    probability, count = marks.probability.astype(np.float64), np.diff(begin, append=len(label))
    columns = zip(
        location.base.time(np.minimum.reduceat(marks.sample, begin)).tolist(),
        location.base.time(np.maximum.reduceat(marks.sample, begin) + 1).tolist(),
        np.split(marks.cell[head], borders[1:]),
        np.split(seen, borders[1:]),
        (np.add.reduceat(probability, begin) / count).tolist(),
        np.maximum.reduceat(surprise(probability, marks.state), begin).tolist(),
        count.tolist(),
        strict=True,
    )
    judged = (criterion.confidence, criterion.rule, criterion.revision)
    events = [
        with_seen(AnomalyRecord(location.id, 0, start, stop, cells, 0, mean, peak, *judged, marks=count), bits)
        for start, stop, cells, bits, mean, peak, count in columns
    ]
    return sorted(events, key=lambda event: (event.start, int(event.cells[0])))


def with_seen(event: AnomalyRecord, seen: NDArray[np.uint8]) -> AnomalyRecord:
    """The event when its cells were seen so: `observed` says how most of them were."""
    occupied, free = (np.count_nonzero(seen & bit) for bit in (SEEN_OCCUPIED, SEEN_FREE))
    return replace(event, observed=int(occupied >= free), seen=seen if occupied and free else None)

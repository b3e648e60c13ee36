"""Judge: find the surprising measurements and group them into events."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tidemap.history.measurements import Measurements
from tidemap.space.regions import label_regions
from tidemap.spectral.anomaly import Rule, is_anomalous, surprise, surprising
from tidemap.spectral.prediction import predict_times
from tidemap.spectral.spectrum import Spectrum
from tidemap.storage.records import AnomalyRecord, LocationRecord


@dataclass(frozen=True, slots=True, eq=False)
class Marks:
    """Surprising measurements, distinct in (sample, cell); (n,) each."""

    sample: NDArray[np.int64]
    cell: NDArray[np.int64]
    state: NDArray[np.uint8]
    probability: NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Criterion:
    """What counts as an anomaly, and the revision it was judged by."""

    confidence: float
    rule: Rule
    revision: int


def judge(location: LocationRecord, spectrum: Spectrum, measurements: Measurements) -> list[AnomalyRecord]:
    """The events among new measurements, in order, judged by rule `surprise` at the location's confidence."""
    criterion = Criterion(location.confidence, "surprise", location.revision)
    if len(measurements.heads) == 1 and location.n_cells > 1:
        marks = _marks_of_snapshot(location, spectrum, measurements)
    else:
        sample, standing = _standing(location, measurements)
        rows, probability = _surprising(location, spectrum, sample, standing)
        marks = Marks(sample[rows], standing.cell[rows].astype(np.int64), standing.state[rows], probability)
    return group(location, marks, criterion)


def _marks_of_snapshot(location: LocationRecord, spectrum: Spectrum, snapshot: Measurements) -> Marks:
    """Those among measurements of one time."""
    sample = location.base.sample(snapshot.time[:1])
    rows, probability = surprising(
        spectrum, float(location.base.time(sample[0])), snapshot.cell, snapshot.state, location.confidence
    )
    cell = snapshot.cell[rows].astype(np.int64)
    fresh = np.diff(cell, prepend=-1) != 0
    rows = rows[fresh]
    return Marks(np.repeat(sample, len(rows)), cell[fresh], snapshot.state[rows], probability[fresh])


def _standing(location: LocationRecord, measurements: Measurements) -> tuple[NDArray[np.int64], Measurements]:
    """The measurements that stand among these, which are in order, by sample and cell, and their samples."""
    sample, ordered = measurements.samples(location.base), measurements
    heads = measurements.heads
    if len(np.unique(sample[heads])) < len(heads):
        order = np.lexsort((ordered.state, ordered.time, ordered.cell, sample))
        sample, ordered = sample[order], ordered.select(order)
    last = np.ones(len(sample), np.bool_)
    last[:-1] = (sample[1:] != sample[:-1]) | (ordered.cell[1:] != ordered.cell[:-1])
    return (sample, ordered) if last.all() else (sample[last], ordered.select(last))


def _surprising(
    location: LocationRecord, spectrum: Spectrum, sample: NDArray[np.int64], standing: Measurements
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """The rows that are surprising, of measurements by sample and cell, and their probabilities."""
    if location.n_cells == 1:
        p = predict_times(spectrum, location.base.time(sample), [0])[0]
        rows = np.flatnonzero(is_anomalous(p, standing.state, location.confidence))
        return rows, p[rows]
    heads = [0, *(np.flatnonzero(sample[1:] != sample[:-1]) + 1).tolist()]
    found = []
    for begin, end in pairwise([*heads, len(sample)]):
        part = slice(begin, end)
        time = float(location.base.time(sample[begin]))
        rows, p = surprising(spectrum, time, standing.cell[part], standing.state[part], location.confidence)
        found.append((rows + begin, p))
    return np.concatenate([rows for rows, _ in found]), np.concatenate([p for _, p in found])


def group(location: LocationRecord, marks: Marks, criterion: Criterion) -> list[AnomalyRecord]:
    """Events: connected marks of one state, of at least `min_cells` cells; in order of their start."""
    least = min(location.min_cells, location.n_cells)
    if len(marks.cell) < least:
        return []
    label = label_regions(location.cells, marks.sample, marks.cell, marks.state)
    # A region has no more cells than marks: what is too small is not looked at any further.
    large = np.bincount(label)[label] >= least
    if not large.any():
        return []
    rows = np.flatnonzero(large)
    rows = rows[np.lexsort((marks.cell[rows], label[rows]))]
    label, cell, sample, state = label[rows], marks.cell[rows], marks.sample[rows], marks.state[rows]
    probability = marks.probability[rows].astype(np.float64)
    begin = np.flatnonzero(np.diff(label, prepend=-1))
    columns = zip(
        location.base.time(np.minimum.reduceat(sample, begin)).tolist(),
        location.base.time(np.maximum.reduceat(sample, begin) + 1).tolist(),
        _distinct(label, cell),
        state[begin].tolist(),
        (np.add.reduceat(probability, begin) / np.diff(begin, append=len(label))).tolist(),
        np.maximum.reduceat(surprise(probability, state), begin).tolist(),
        strict=True,
    )
    judged = (criterion.confidence, criterion.rule, criterion.revision)
    events = [
        AnomalyRecord(location.id, 0, start, stop, cells, observed, mean, peak, *judged)
        for start, stop, cells, observed, mean, peak in columns
        if len(cells) >= least
    ]
    return sorted(events, key=lambda event: (event.start, int(event.cells[0])))


def _distinct(label: NDArray[np.int64], cell: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """The distinct cells of every label, both sorted by label and cell."""
    first = np.diff(label, prepend=-1) != 0
    fresh = first | (np.diff(cell, prepend=-1) != 0)
    return np.split(cell[fresh], np.flatnonzero(first[fresh])[1:])

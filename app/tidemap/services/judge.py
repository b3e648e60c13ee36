"""Judge: find the surprising measurements."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tidemap.history.measurements import Measurements
from tidemap.services.grouping import Criterion, Marks, group
from tidemap.services.spectra import Fitted
from tidemap.spectral.anomaly import is_anomalous, surprising
from tidemap.spectral.prediction import predict_times
from tidemap.storage.records import AnomalyRecord, LocationRecord


def judge(model: Fitted, measurements: Measurements) -> list[AnomalyRecord]:
    """The events among new measurements, in order, judged by rule `surprise` at the location's confidence.

    The model has all their cells.
    """
    location = model.location
    criterion = Criterion(location.confidence, "surprise", location.revision)
    if len(measurements.heads) == 1 and location.n_cells > 1:
        marks = _marks_of_snapshot(model, measurements)
    else:
        sample, standing = _standing(location, measurements)
        rows, probability = _surprising(model, sample, standing)
        marks = Marks(sample[rows], standing.cell[rows].astype(np.int64), standing.state[rows], probability)
    return group(location, marks, criterion)


def _marks_of_snapshot(model: Fitted, snapshot: Measurements) -> Marks:
    """Those among measurements of one time."""
    sample = model.location.base.sample(snapshot.time[:1])
    rows, probability = _surprising_at(model, int(sample[0]), snapshot.cell, snapshot.state)
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
    model: Fitted, sample: NDArray[np.int64], standing: Measurements
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """The rows that are surprising, of measurements by sample and cell, and their probabilities."""
    location = model.location
    if not len(sample):
        return np.zeros(0, np.int64), np.zeros(0, np.float32)
    if location.n_cells == 1:
        p = predict_times(model.spectrum, location.base.time(sample), [0])[0]
        rows = np.flatnonzero(is_anomalous(p, standing.state, location.confidence))
        return rows, p[rows]
    heads = [0, *(np.flatnonzero(sample[1:] != sample[:-1]) + 1).tolist()]
    found = []
    for begin, end in pairwise([*heads, len(sample)]):
        part = slice(begin, end)
        rows, p = _surprising_at(model, int(sample[begin]), standing.cell[part], standing.state[part])
        found.append((rows + begin, p))
    return np.concatenate([rows for rows, _ in found]), np.concatenate([p for _, p in found])


def _surprising_at(
    model: Fitted, sample: int, cell: NDArray[np.uint32], state: NDArray[np.uint8]
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """The same of measurements in one sample."""
    time = float(model.location.base.time(sample))
    return surprising(model.spectrum, time, model.rows(cell), state, model.location.confidence)

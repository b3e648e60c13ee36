"""Detect: search a part of the history for events; nothing is stored."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from tidemap.errors import CorruptChunkError, InvalidInputError, refuse_reversed
from tidemap.history.chunks import CHUNK_CELLS
from tidemap.history.history import UNOBSERVED
from tidemap.services.anomalies import Anomaly, anomaly_of
from tidemap.services.context import Context
from tidemap.services.history import read_history, window
from tidemap.services.judge import Criterion, Marks, group
from tidemap.services.spectra import Fitted, fitted
from tidemap.spectral.anomaly import Rule, is_anomalous
from tidemap.spectral.prediction import predict_times
from tidemap.storage.records import LocationRecord

MAX_MARKS = 2_000_000
"""Surprising cells that one search may find."""
BLOCK_VALUES = 1 << 20
"""Probabilities that a search holds at once."""


@dataclass(frozen=True, slots=True)
class DetectQuery:
    """Which part of the history to search, times [start, stop); None: the location's or the revision's own."""

    start: float
    stop: float
    confidence: float | None = None
    rule: Rule = "surprise"
    order: int | None = None
    estimator: str | None = None


def detect(
    ctx: Context, name: str, query: DetectQuery, check: Callable[[], None] = lambda: None
) -> tuple[list[Anomaly], int]:
    """The events of the history and the revision they were judged by; nothing is stored.

    Chunks that are damaged are left out. `check` is called between blocks; what it raises ends the search.
    Raises LocationNotFoundError, NoModelError, InvalidInputError, CorruptChunkError where there is one chunk only.
    """
    refuse_reversed(query.start, query.stop)
    model = fitted(ctx, name, query.estimator, query.order)
    location = model.location
    confidence = location.confidence if query.confidence is None else query.confidence
    criterion = Criterion(confidence, query.rule, model.revision.revision)
    first, last = window(ctx, location)
    start, stop = max(first, int(location.base.sample(query.start))), min(last, _ceiling(location, query.stop))
    parts: list[Marks] = []
    found = 0
    for chunk in range(location.n_chunks):
        try:
            for part in _search(ctx, model, chunk, start, stop, criterion):
                check()
                parts.append(part)
                found += len(part.cell)
                if found > MAX_MARKS:
                    raise InvalidInputError.at("stop", "more than two million anomalous cells; search a shorter time")
        except CorruptChunkError:
            if location.n_chunks == 1:
                raise
    marks = _joined(parts)
    return [anomaly_of(location, event) for event in group(location, marks, criterion)], model.revision.revision


def _ceiling(location: LocationRecord, time: float) -> int:
    """The first sample that starts at or after a time."""
    sample = int(location.base.sample(time))
    return sample if float(location.base.time(sample)) == time else sample + 1


def _search(ctx: Context, model: Fitted, chunk: int, start: int, stop: int, criterion: Criterion) -> Iterator[Marks]:
    """The marks of a chunk, block by block of time."""
    location = model.location
    size = location.chunk_size(chunk)
    step = max(1, BLOCK_VALUES // size)
    for low in range(start, stop, step):
        high = min(low + step, stop)
        states = read_history(ctx, location, chunk, low, high).states()
        cells = chunk * CHUNK_CELLS + np.arange(size)
        probability = predict_times(model.spectrum, location.base.time(np.arange(low, high)), cells)
        marked = (states != UNOBSERVED) & is_anomalous(probability, states, criterion.confidence, criterion.rule)
        row, column = np.nonzero(marked)
        yield Marks(low + column, cells[row], states[row, column], probability[row, column])


def _joined(parts: list[Marks]) -> Marks:
    if not parts:
        empty = np.empty(0, np.int64)
        return Marks(empty, empty, np.empty(0, np.uint8), np.empty(0, np.float32))
    return Marks(*(np.concatenate([getattr(part, field) for part in parts]) for field in Marks.__dataclass_fields__))

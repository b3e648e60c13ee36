"""Detect: search a part of the history for events; nothing is stored."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import CorruptChunkError, InvalidInputError, refuse_reversed
from tidemap.history.chunks import CHUNK_CELLS
from tidemap.history.history import UNOBSERVED
from tidemap.services.anomalies import Anomaly, anomaly_of
from tidemap.services.context import Context
from tidemap.services.grouping import Criterion, Marks, group
from tidemap.services.history import read_history, window
from tidemap.services.parts import SEEN
from tidemap.services.spectra import Fitted, fitted
from tidemap.space.regions import Array, WasRead
from tidemap.spectral.anomaly import Rule, is_anomalous
from tidemap.spectral.prediction import predict_times
from tidemap.storage.records import AnomalyRecord, LocationRecord

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
    model = fitted(ctx, name, query.estimator, query.order, part=SEEN)
    location = model.location
    confidence = location.confidence if query.confidence is None else query.confidence
    criterion = Criterion(confidence, query.rule, model.revision.revision)
    samples = int(location.base.sample(query.start)), _ceiling(location, query.stop)
    events = search(ctx, model, samples, criterion, check)
    return [anomaly_of(location, event) for event in events], model.revision.revision


def search(
    ctx: Context, model: Fitted, samples: tuple[int, int], criterion: Criterion, check: Callable[[], None]
) -> list[AnomalyRecord]:
    """The events of the history in samples [start, stop), as `detect` finds them. Raises as `detect`."""
    location, (first, last) = model.location, window(ctx, model.location)
    start, stop = max(first, samples[0]), min(last, samples[1])
    parts: list[Marks] = []
    found = 0
    for chunk in model.held_chunks:
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
    return group(location, _joined(parts), criterion, location.gap_samples, _was_read(ctx, location))


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
        probability = predict_times(model.spectrum, location.base.time(np.arange(low, high)), model.rows(cells))
        marked = (states != UNOBSERVED) & is_anomalous(probability, states, criterion.confidence, criterion.rule)
        row, column = np.nonzero(marked)
        yield Marks(low + column, cells[row], states[row, column], probability[row, column])


def _was_read(ctx: Context, location: LocationRecord) -> WasRead | None:
    """Whether cells were read in samples; None where that does not matter, as the location says how long a gap is.

    What is held was read. Raises CorruptChunkError.
    """

    def was_read(cell: Array, sample: Array) -> NDArray[np.bool_]:
        found = np.zeros(len(cell), np.bool_)
        for chunk in np.unique(cell // CHUNK_CELLS).tolist():
            rows = np.flatnonzero(cell // CHUNK_CELLS == chunk)
            history = read_history(ctx, location, chunk, int(sample[rows].min()), int(sample[rows].max()) + 1)
            found[rows] = history.observed_at(cell[rows] % CHUNK_CELLS, sample[rows])
        return found

    return None if location.event_gap_s is not None else was_read


def _joined(parts: list[Marks]) -> Marks:
    if not parts:
        empty = np.empty(0, np.int64)
        return Marks(empty, empty, np.empty(0, np.uint8), np.empty(0, np.float32))
    return Marks(*(np.concatenate([getattr(part, field) for part in parts]) for field in Marks.__dataclass_fields__))

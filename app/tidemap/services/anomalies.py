"""Anomalies: judging measurements, grouping the surprising ones into events, listing and acknowledging events."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import CorruptChunkError, InvalidInputError, refuse_reversed
from tidemap.history.history import UNOBSERVED
from tidemap.history.measurements import Measurements
from tidemap.schemas.anomalies import Event
from tidemap.services.context import Context
from tidemap.services.history import read_history, window
from tidemap.services.spectra import Fitted, fitted
from tidemap.space.regions import label_regions
from tidemap.spectral.anomaly import Rule, is_anomalous, surprise, surprising
from tidemap.spectral.prediction import predict_times
from tidemap.spectral.spectrum import Spectrum
from tidemap.storage.anomalies import EventFilter
from tidemap.storage.records import CHUNK_CELLS, AnomalyRecord, LocationRecord
from tidemap.storage.work import Work

MAX_MARKS = 2_000_000
"""Surprising cells that one search may find."""
BLOCK_VALUES = 1 << 22
"""Probabilities that a search holds at once."""


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


def judge(place: LocationRecord, spectrum: Spectrum, measurements: Measurements) -> list[AnomalyRecord]:
    """The events among new measurements, in order, judged by rule `surprise` at the location's confidence."""
    criterion = Criterion(place.confidence, "surprise", place.revision)
    if len(measurements.heads) == 1 and place.n_cells > 1:
        marks = _marks_of_look(place, spectrum, measurements)
    else:
        sample, standing = _standing(place, measurements)
        rows, probability = _surprising(place, spectrum, sample, standing)
        marks = Marks(sample[rows], standing.cell[rows].astype(np.int64), standing.state[rows], probability)
    return group(place, marks, criterion)


def _marks_of_look(place: LocationRecord, spectrum: Spectrum, look: Measurements) -> Marks:
    """Those among measurements of one time."""
    sample = place.base.sample(look.time[:1])
    rows, probability = surprising(spectrum, float(place.base.time(sample[0])), look.cell, look.state, place.confidence)
    cell = look.cell[rows].astype(np.int64)
    fresh = np.diff(cell, prepend=-1) != 0
    rows = rows[fresh]
    return Marks(np.repeat(sample, len(rows)), cell[fresh], look.state[rows], probability[fresh])


def _standing(place: LocationRecord, measurements: Measurements) -> tuple[NDArray[np.int64], Measurements]:
    """The measurements that stand among these, which are in order, by sample and cell, and their samples."""
    sample, ordered = measurements.samples(place.base), measurements
    heads = measurements.heads
    if len(np.unique(sample[heads])) < len(heads):
        order = np.lexsort((ordered.state, ordered.time, ordered.cell, sample))
        sample, ordered = sample[order], ordered.select(order)
    last = np.ones(len(sample), np.bool_)
    last[:-1] = (sample[1:] != sample[:-1]) | (ordered.cell[1:] != ordered.cell[:-1])
    return (sample, ordered) if last.all() else (sample[last], ordered.select(last))


def _surprising(
    place: LocationRecord, spectrum: Spectrum, sample: NDArray[np.int64], standing: Measurements
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """The rows that are surprising, of measurements by sample and cell, and their probabilities."""
    if place.n_cells == 1:
        p = predict_times(spectrum, place.base.time(sample), [0])[0]
        rows = np.flatnonzero(is_anomalous(p, standing.state, place.confidence))
        return rows, p[rows]
    heads = [0, *(np.flatnonzero(sample[1:] != sample[:-1]) + 1).tolist()]
    found = []
    for begin, end in pairwise([*heads, len(sample)]):
        part = slice(begin, end)
        time = float(place.base.time(sample[begin]))
        rows, p = surprising(spectrum, time, standing.cell[part], standing.state[part], place.confidence)
        found.append((rows + begin, p))
    return np.concatenate([rows for rows, _ in found]), np.concatenate([p for _, p in found])


def group(place: LocationRecord, marks: Marks, criterion: Criterion) -> list[AnomalyRecord]:
    """Events: connected marks of one state, of at least `min_cells` cells; in order of their start."""
    least = min(place.min_cells, place.n_cells)
    if len(marks.cell) < least:
        return []
    label = label_regions(place.cells, marks.sample, marks.cell, marks.state)
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
        place.base.time(np.minimum.reduceat(sample, begin)).tolist(),
        place.base.time(np.maximum.reduceat(sample, begin) + 1).tolist(),
        _distinct(label, cell),
        state[begin].tolist(),
        (np.add.reduceat(probability, begin) / np.diff(begin, append=len(label))).tolist(),
        np.maximum.reduceat(surprise(probability, state), begin).tolist(),
        strict=True,
    )
    judged = (criterion.confidence, criterion.rule, criterion.revision)
    events = [
        AnomalyRecord(place.id, 0, start, stop, cells, observed, mean, peak, *judged)
        for start, stop, cells, observed, mean, peak in columns
        if len(cells) >= least
    ]
    return sorted(events, key=lambda event: (event.start, int(event.cells[0])))


def _distinct(label: NDArray[np.int64], cell: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """The distinct cells of every label, both sorted by label and cell."""
    first = np.diff(label, prepend=-1) != 0
    fresh = first | (np.diff(cell, prepend=-1) != 0)
    return np.split(cell[fresh], np.flatnonzero(first[fresh])[1:])


@dataclass(frozen=True, slots=True)
class DetectQuery:
    """Which part of the history to search, times [start, stop); None: the location's or the revision's own."""

    start: float
    stop: float
    confidence: float | None = None
    rule: Rule = "surprise"
    order: int | None = None
    estimator: str | None = None


def detect(ctx: Context, name: str, query: DetectQuery) -> tuple[list[Event], int]:
    """The events of the history and the revision they were judged by; nothing is stored.

    Chunks that are damaged are left out.
    Raises LocationNotFoundError, NoModelError, InvalidInputError, CorruptChunkError where there is one chunk only.
    """
    refuse_reversed(query.start, query.stop)
    model = fitted(ctx, name, query.estimator, query.order)
    place = model.place
    confidence = place.confidence if query.confidence is None else query.confidence
    criterion = Criterion(confidence, query.rule, model.revision.revision)
    first, last = window(ctx, place)
    start, stop = max(first, int(place.base.sample(query.start))), min(last, _ceiling(place, query.stop))
    parts: list[Marks] = []
    found = 0
    for chunk in range(place.n_chunks):
        try:
            for part in _search(ctx, model, chunk, start, stop, criterion):
                parts.append(part)
                found += len(part.cell)
                if found > MAX_MARKS:
                    raise InvalidInputError.at("stop", "more than two million anomalous cells; search a shorter time")
        except CorruptChunkError:
            if place.n_chunks == 1:
                raise
    marks = _joined(parts)
    return [wire(place, event) for event in group(place, marks, criterion)], model.revision.revision


def _ceiling(place: LocationRecord, time: float) -> int:
    """The first sample that starts at or after a time."""
    sample = int(place.base.sample(time))
    return sample if float(place.base.time(sample)) == time else sample + 1


def _search(ctx: Context, model: Fitted, chunk: int, start: int, stop: int, criterion: Criterion) -> Iterator[Marks]:
    """The marks of a chunk, block by block of time."""
    place = model.place
    size = place.chunk_size(chunk)
    step = max(1, BLOCK_VALUES // size)
    for low in range(start, stop, step):
        high = min(low + step, stop)
        states = read_history(ctx, place, chunk, low, high).states()
        cells = chunk * CHUNK_CELLS + np.arange(size)
        probability = predict_times(model.spectrum, place.base.time(np.arange(low, high)), cells)
        marked = (states != UNOBSERVED) & is_anomalous(probability, states, criterion.confidence, criterion.rule)
        row, column = np.nonzero(marked)
        yield Marks(low + column, cells[row], states[row, column], probability[row, column])


def _joined(parts: list[Marks]) -> Marks:
    if not parts:
        empty = np.empty(0, np.int64)
        return Marks(empty, empty, np.empty(0, np.uint8), np.empty(0, np.float32))
    return Marks(*(np.concatenate([getattr(part, field) for part in parts]) for field in Marks.__dataclass_fields__))


@dataclass(frozen=True, slots=True)
class EventQuery:
    """Which stored events; None leaves a condition out. Times overlap [start, stop)."""

    location: str | None = None
    after: int | None = None
    limit: int | None = 100
    start: float | None = None
    stop: float | None = None
    min_surprise: float | None = None
    acknowledged: bool | None = None


def list_events(ctx: Context, query: EventQuery) -> list[Event]:
    """Stored events, oldest first. Raises LocationNotFoundError, InvalidInputError."""
    refuse_reversed(query.start, query.stop)
    with ctx.store.read() as work:
        place = work.locations.get(query.location) if query.location is not None else None
        wanted = EventFilter(
            place.id if place else None,
            query.after,
            query.limit,
            query.start,
            query.stop,
            query.min_surprise,
            query.acknowledged,
        )
        records = work.anomalies.list(wanted)
        places = {each.id: each for each in ([place] if place else work.locations.list())}
    return [_known(ctx, places[record.location_id], record) for record in records]


def get_event(ctx: Context, anomaly_id: int) -> Event:
    """A stored event. Raises AnomalyNotFoundError."""
    with ctx.store.read() as work:
        record = work.anomalies.get(anomaly_id)
        place = work.locations.by_id(record.location_id)
    return _known(ctx, place, record)


def acknowledge(ctx: Context, anomaly_id: int, by: str, note: str | None) -> Event:
    """Raises AnomalyNotFoundError."""

    def run(work: Work) -> tuple[LocationRecord, AnomalyRecord]:
        record = work.anomalies.acknowledge(anomaly_id, by, ctx.clock(), note)
        return work.locations.by_id(record.location_id), record

    return _known(ctx, *ctx.store.write(run))


def _known(ctx: Context, place: LocationRecord, record: AnomalyRecord) -> Event:
    """A stored event as the API shows it; one whose cells cannot be read is shown without them."""
    if record.damage is not None:
        ctx.damage.found(place.id, record.damage)
    return wire(place, record)


def wire(place: LocationRecord, record: AnomalyRecord) -> Event:
    """An event as the API shows it."""
    box = place.grid.bounding_box(record.cells) if place.grid and len(record.cells) else None
    shared = ("start", "stop", "observed", "probability", "surprise", "confidence", "rule", "revision")
    people = ("acknowledged_by", "acknowledged_at", "note")
    return Event(
        id=record.id or None,
        location=place.name,
        cells=record.cells.tolist(),
        cells_total=len(record.cells),
        bbox=None if box is None else list(box),
        **{field: getattr(record, field) for field in (*shared, *people)},
    )

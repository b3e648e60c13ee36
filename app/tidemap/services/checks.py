"""Checks of stored rows against one another and against what their blobs hold, one location at a time.

Each check gives pairs of where, in the words of the tables, and what is wrong there.
"""

import json
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial

import numpy as np

from tidemap.errors import CorruptChunkError
from tidemap.history.ends import Ends
from tidemap.history.segment import SEGMENT_SAMPLES, Segment
from tidemap.space.grid import Extent
from tidemap.storage.blobs import (
    unpack_event,
    unpack_json,
    unpack_measurements,
    unpack_scan,
    unpack_segment,
    unpack_spectrum,
)
from tidemap.storage.inspection import Row, Snapshot
from tidemap.storage.records import LocationRecord, RevisionRecord

Wrong = tuple[str, str]
"""Where, and what is wrong there."""
JOB_STATES = {"queued", "running", "done", "failed", "cancelled"}
UNREADABLE = (ValueError, TypeError, KeyError, IndexError, OverflowError)
"""What damaged contents raise when they are read."""


@dataclass
class LogTotals:
    """How much was looked at."""

    locations: int = 0
    blobs: int = 0
    observations: int = 0


def _unreadable(where: str, read: Callable[[], object]) -> Iterator[Wrong]:
    """What is wrong with contents, where reading them fails."""
    try:
        read()
    except CorruptChunkError as error:
        yield where, error.why
    except UNREADABLE as error:
        yield where, f"its contents do not fit: {error}"


def location_of(row: Row) -> LocationRecord:
    """The record of a location's row; ValueError saying why there is none."""
    try:
        location = LocationRecord.of(row._mapping)
        fits = location.base and location.n_cells > 0 and (location.extent is Extent.SINGLE) == (location.grid is None)
    except UNREADABLE as error:
        raise ValueError(f"they cannot be read: {error}") from error
    if not fits:
        raise ValueError("its kind and its grid do not fit together")
    return location


def check_location(snapshot: Snapshot, location: LocationRecord, tally: LogTotals) -> Iterator[Wrong]:
    """Everything that belongs to a location."""
    if not 0 <= location.compacted_seq <= location.observation_seq:
        yield "counters", f"{location.compacted_seq} of {location.observation_seq} observations are compacted"
    for check in (_log, _idempotency, _scans, _history, _revisions, _spectra, _anomalies):
        yield from check(snapshot, location, tally)
    yield from _jobs(snapshot, location)


def _log(snapshot: Snapshot, location: LocationRecord, tally: LogTotals) -> Iterator[Wrong]:
    before: int | None = None
    first, total = location.observation_seq + 1, 0
    for row in snapshot.log(location.id):
        where = f"observation {row.id}"
        tally.observations += 1
        total += row.measurements
        if before is None:
            first = row.id
        elif row.id != before + 1:
            yield where, f"the log goes from {before} to {row.id}; the observations between are missing"
        before = row.id
        yield from _observation(location, row, where, tally)
    if (before or first - 1) != location.observation_seq:
        yield "log", f"it ends with observation {before or 0}, but {location.observation_seq} were counted"
    if first > location.compacted_seq + 1:
        yield "log", f"it begins with observation {first}, but only {location.compacted_seq} are compacted"
    # The log of what is compacted is pruned from its beginning; what is left of it can only be fewer.
    if total > location.measurements or (first == 1 and total < location.measurements):
        yield "log", f"it holds {total} measurements, but {location.measurements} were counted"


def _observation(location: LocationRecord, row: Row, where: str, tally: LogTotals) -> Iterator[Wrong]:
    if row.idempotency_key is not None and row.body_hash is None:
        yield where, "it has an idempotency key without the hash of its body"
    # What is compacted may have been deleted, or be too old by now.
    known = row.id <= location.compacted_seq or (location.last_time is not None and row.last_time <= location.last_time)
    if row.last_time < row.first_time or not known:
        yield where, "its times are not those that the location counted"
    if row.payload is None:
        if row.id > location.compacted_seq:
            yield where, "it is pending, but its payload is gone"
        return
    tally.blobs += 1
    damage = list(_unreadable(where, partial(_match_measurements, location, row)))
    # Compaction leaves the payload of an observation that it cannot read.
    if row.id <= location.compacted_seq and not damage:
        yield where, "it is both compacted and pending: its payload is still there"
    yield from damage


def _match_measurements(location: LocationRecord, row: Row) -> None:
    """ValueError where the payload and the row differ."""
    measurements = unpack_measurements(row.payload, "observation")
    if len(measurements) != row.measurements or len(measurements.cell) != row.measurements:
        raise ValueError(f"it holds {len(measurements)} measurements, its row says {row.measurements}")
    if measurements.cell.max(initial=0) >= location.n_cells:
        raise ValueError(f"cell {measurements.cell.max()} is outside of the location's {location.n_cells}")
    if (measurements.time.min(), measurements.time.max()) != (row.first_time, row.last_time):
        raise ValueError("its times are not those of its row")


def _idempotency(snapshot: Snapshot, location: LocationRecord, _: LogTotals) -> Iterator[Wrong]:
    for row in snapshot.repeated_keys(location.id):
        yield f"idempotency key {row.idempotency_key!r}", f"{row.number} observations have it"


def _history(snapshot: Snapshot, location: LocationRecord, tally: LogTotals) -> Iterator[Wrong]:
    standing: list[int] = []
    for row in snapshot.segments(location.id):
        chunk, aside = (row.chunk, "") if row.chunk >= 0 else (-1 - row.chunk, " put aside")
        where = f"history{aside} chunk {chunk}, segment {row.segment}"
        tally.blobs += 1
        if chunk >= location.n_chunks:
            yield where, f"the location has {location.n_chunks} chunks"
            continue
        yield from _unreadable(where, partial(_match_segment, location, chunk, row, standing))
    if sum(standing) > location.observations:
        yield "history", f"{sum(standing)} measurements stand, but only {location.observations} were counted"


def _match_segment(location: LocationRecord, chunk: int, row: Row, standing: list[int]) -> None:
    """Adds how many measurements stand; ValueError where a segment contradicts itself, its row or its location."""
    segment = unpack_segment(row.payload, row.segment, "history")
    history = segment.history.check()
    if history.n_cells != location.chunk_size(chunk):
        raise ValueError(f"it holds {history.n_cells} cells, the chunk has {location.chunk_size(chunk)}")
    for each in (segment.rank, segment.surplus):
        if each is not None and each.shape != (history.n_cells, SEGMENT_SAMPLES):
            raise ValueError("its ranks, or its counts, are not one a cell and sample")
    _match_times(location, segment)
    if segment.ends is not None:
        _match_ends(location, segment, segment.ends)
    standing.append(int(history.count_observed().sum()) + (0 if segment.ends is None else len(segment.ends)))


def _match_times(location: LocationRecord, segment: Segment) -> None:
    history = segment.history
    samples = location.base.sample(segment.time)
    if np.any(np.diff(segment.time) <= 0) or np.any((samples < history.start) | (samples >= history.stop)):
        raise ValueError("its times are not ascending within its samples")
    seen = np.bitwise_or.reduce(history.observed, axis=0)
    observed = history.start + np.flatnonzero(np.unpackbits(seen, bitorder="little"))
    if not np.array_equal(np.unique(samples), observed):
        raise ValueError("its times are not those of the samples that were observed")
    if len(segment.time) and (location.last_time is None or segment.time[-1] > location.last_time):
        raise ValueError("it is later than the last measurement that the location counted")


def _match_ends(location: LocationRecord, segment: Segment, ends: Ends) -> None:
    """ValueError where what sensors said of not being available is not of the segment."""
    samples = location.base.sample(ends.time)
    if len(ends.time) != len(ends.cell) or ends.cell.max(initial=0) >= segment.history.n_cells:
        raise ValueError("its ends are not one a cell of it")
    if np.any((samples < segment.history.start) | (samples >= segment.history.stop)):
        raise ValueError("its ends are not within its samples")


def _revisions(snapshot: Snapshot, location: LocationRecord, _: LogTotals) -> Iterator[Wrong]:
    stored = set()
    for row in snapshot.revisions(location.id):
        where = f"revision {row.revision}"
        stored.add(row.revision)
        yield from _unreadable(where, partial(_match_revision, location, row))
        if row.revision != location.revision:
            yield where, f"the location's revision is {location.revision}"
    if location.revision and location.revision not in stored:
        yield f"revision {location.revision}", "it is missing"


def _match_revision(location: LocationRecord, row: Row) -> None:
    """ValueError where a revision knows more than its location."""
    record = RevisionRecord.of(row._mapping)
    if record.observation_seq > location.observation_seq or record.measurements > location.measurements:
        raise ValueError("it was fitted on more than the location has counted")
    if record.stop <= record.start:
        raise ValueError("its window is empty")


def _spectra(snapshot: Snapshot, location: LocationRecord, tally: LogTotals) -> Iterator[Wrong]:
    """Revisions other than the current one are those of updates that run, or were broken off, and may have gaps."""
    missing = _expected(snapshot, location) if location.revision else set()
    for row in snapshot.spectra(location.id):
        where = f"spectrum chunk {row.chunk} of revision {row.revision}"
        tally.blobs += 1
        if row.revision == location.revision:
            missing.discard(row.chunk)
        if not 0 <= row.chunk < location.n_chunks:
            yield where, f"the location has {location.n_chunks} chunks"
            continue
        yield from _unreadable(where, partial(_match_spectrum, location, row))
    for chunk in sorted(missing):
        yield f"spectrum chunk {chunk} of revision {location.revision}", "it is missing"


def _expected(snapshot: Snapshot, location: LocationRecord) -> set[int]:
    """The chunks that the current revision has a spectrum for; none where it cannot be read, as is said elsewhere."""
    for row in snapshot.revisions(location.id):
        with suppress(CorruptChunkError, ValueError):
            if row.revision == location.revision:
                chunks = RevisionRecord.of(row._mapping).chunks
                return set(range(location.n_chunks) if chunks is None else chunks.tolist())
    return set()


def _match_spectrum(location: LocationRecord, row: Row) -> None:
    """ValueError where a spectrum does not fit its chunk, or itself."""
    spectrum = unpack_spectrum(row.payload, "spectrum", location.base)
    if spectrum.n_cells != location.chunk_size(row.chunk):
        raise ValueError(f"it has {spectrum.n_cells} cells, the chunk has {location.chunk_size(row.chunk)}")
    if np.any(np.diff(spectrum.cell) <= 0) or np.any((spectrum.cell < 0) | (spectrum.cell >= spectrum.n_cells)):
        raise ValueError("its varying cells are not ascending within the chunk")
    if spectrum.index.size and spectrum.index.max() >= spectrum.n_waves:
        raise ValueError("it names a wave that its table lacks")


def _anomalies(snapshot: Snapshot, location: LocationRecord, tally: LogTotals) -> Iterator[Wrong]:
    for row in snapshot.anomalies(location.id):
        tally.blobs += 1
        yield from _unreadable(f"anomaly {row.id}", partial(_match_anomaly, location, row))


def _match_anomaly(location: LocationRecord, row: Row) -> None:
    cells, _ = unpack_event(row.cells, "anomaly")
    if not len(cells) or cells.max() >= location.n_cells:
        raise ValueError(f"its cells are not among the location's {location.n_cells}")
    if row.stop < row.start or row.observed not in (0, 1):
        raise ValueError("its start and stop, or what was observed, cannot be")


def _scans(snapshot: Snapshot, location: LocationRecord, tally: LogTotals) -> Iterator[Wrong]:
    for row in snapshot.scans(location.id):
        where = f"scan {row.id}"
        tally.blobs += 1
        yield from _unreadable(where, partial(unpack_json, row.registration, where))
        if row.payload is not None:
            tally.blobs += 1
            yield from _unreadable(where, partial(unpack_scan, row.payload, where))


def _jobs(snapshot: Snapshot, location: LocationRecord) -> Iterator[Wrong]:
    for row in snapshot.jobs(location.id):
        yield from _unreadable(f"job {row.id}", partial(_match_job, row))


def _match_job(row: Row) -> None:
    json.loads(row.request)
    if row.result is not None:
        unpack_json(row.result, "job")
    if row.state not in JOB_STATES:
        raise ValueError(f"its state is {row.state!r}")

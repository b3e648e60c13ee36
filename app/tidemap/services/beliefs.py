"""Beliefs: what is believed of cells that a sensor reads which errs, filtered from their readings (DESIGN 2.8)."""

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import CorruptChunkError
from tidemap.history.chunks import CHUNK_CELLS
from tidemap.history.history import NEVER
from tidemap.history.sequences import Sequences
from tidemap.services.context import Context, KeptEvidence
from tidemap.services.history import read_backwards
from tidemap.services.readings import by_chunk, read_later
from tidemap.services.spectra import Fitted
from tidemap.spectral.belief import Beliefs
from tidemap.spectral.detector import Detector
from tidemap.spectral.durations import Durations
from tidemap.spectral.prediction import predict_readings
from tidemap.spectral.sensor import Sensor
from tidemap.storage.records import LEARN, LocationRecord

MAX_READINGS, MIN_READINGS = 4096, 64
"""Of a cell, that its belief is filtered from: fewer where there are many cells."""
MAX_ALL_READINGS = 1 << 26
"""Of all cells of a location."""
ALL = np.iinfo(np.int64).max


def detector_of(model: Fitted) -> Detector | None:
    """What reads the cells; None where its readings are true, or nothing was learned of it yet."""
    learned, sensor = model.revision.detector, model.location.sensor
    if sensor == LEARN:
        return learned
    if not isinstance(sensor, Sensor):
        return None
    return Detector(sensor, learned.durations if learned else Durations.believed(model.location.interval_s))


def beliefs_at(ctx: Context, model: Fitted, cells: NDArray[np.int64], moment: float, before: Beliefs) -> KeptEvidence:
    """What is believed of some cells, ascending, at a moment (Unix seconds).

    before: what was believed of them, by readings that are earlier than all others; without that, a cell's latest
    readings are taken.
    """
    location, found, damaged = model.location, before.rows(np.arange(len(cells))), []
    most = int(np.clip(MAX_ALL_READINGS // location.n_cells, MIN_READINGS, MAX_READINGS))
    for chunk, rows in by_chunk(cells):
        mine = before.rows(rows)
        try:
            sequences = _read(ctx, location, chunk, moment, cells[rows], mine.sample, most)
        except CorruptChunkError:
            damaged.append(chunk)
            mine = Beliefs.none(len(rows), before.detector)
        else:
            p = predict_readings(model.spectrum, model.rows(cells[rows]), sequences, location.base)
            mine = mine.filtered(sequences, p)
        found.put(rows, mine)
    return KeptEvidence(found, damaged)


def _read(
    ctx: Context,
    location: LocationRecord,
    chunk: int,
    moment: float,
    cells: NDArray[np.int64],
    since: NDArray[np.int64],
    most: int,
) -> Sequences:
    """The readings of some cells of a chunk at or before a moment: those after the sample `since` (n,), the latest
    `most` of a cell where that is NEVER."""
    local, sample = cells - chunk * CHUNK_CELLS, int(location.base.sample(moment))
    last = np.full(len(cells), sample)
    if (later := read_later(ctx, location, chunk, moment)) is not None:
        last[later[local]] -= 1
    wanted = np.where(since == NEVER, most, ALL)
    missing, rows, parts = wanted.copy(), np.arange(len(cells)), []
    for piece in read_backwards(ctx, location, chunk, sample) if len(rows) else ():
        found = Sequences.of(piece.cells(local[rows]))
        found = found.select((found.sample <= last[rows][found.cell]) & (found.sample > since[rows][found.cell]))
        parts.append((rows, found))
        missing[rows] -= found.count
        rows = rows[(missing[rows] > 0) & (since[rows] < piece.start - 1)]
        if not rows.size:
            break
    joined = Sequences.joined(len(cells), reversed(parts))
    return joined.select(joined.latest(wanted))

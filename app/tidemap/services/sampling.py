"""Sampling: some chunks and changing cells of a location, which stand for all of them in an update."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import CorruptChunkError
from tidemap.history.history import History
from tidemap.services.context import Context
from tidemap.services.history import read_compacted
from tidemap.spectral.window import PAUSE_S
from tidemap.storage.records import CHUNK_CELLS, LocationRecord

PAUSE_CHUNKS = 8
"""Chunks whose pauses are those of all."""


@dataclass(frozen=True, slots=True, eq=False)
class SampledCells:
    """Some cells (n,) of a location and their history."""

    cell: NDArray[np.int64]
    history: History


def sample_cells(
    ctx: Context, location: LocationRecord, samples: tuple[int, int], check: Callable[[], None], n_cells: int
) -> SampledCells:
    """About `n_cells` to four times as many changing cells, spread evenly over some chunks that can be read."""
    n_chunks = min(location.n_chunks, n_cells)
    cells, parts = [np.zeros(0, np.int64)], []
    for chunk, history in _sample_chunks(ctx, location, samples, check, n_chunks):
        occupied = history.count_occupied()
        changing = np.flatnonzero((occupied > 0) & (occupied < history.count_observed()))
        some = changing[:: max(1, len(changing) * n_chunks // (4 * n_cells))]
        cells.append(chunk * CHUNK_CELLS + some)
        parts.append(history.cells(some))
    return SampledCells(np.concatenate(cells), _stacked(parts, *samples))


def _stacked(parts: Sequence[History], start: int, stop: int) -> History:
    """The cells of histories of the samples [start, stop), one after the other."""
    every = (History.empty(0, start, stop - start), *parts)
    planes = (np.concatenate([part.observed for part in every]), np.concatenate([part.occupied for part in every]))
    return History(start, stop - start, *planes)


def measured(ctx: Context, location: LocationRecord, sampled: SampledCells) -> History:
    """What was measured of sampled cells: without what is held after it."""
    history = sampled.history
    if location.hold_samples is None:
        return history
    as_read, window = replace(location, missing="mask"), (history.start, history.stop)
    chunks = sampled.cell // CHUNK_CELLS
    parts = [
        read_compacted(ctx, as_read, chunk, *window).cells(sampled.cell[chunks == chunk] % CHUNK_CELLS)
        for chunk in np.unique(chunks).tolist()
    ]
    return _stacked(parts, *window)


def seen_samples(
    ctx: Context, location: LocationRecord, samples: tuple[int, int], check: Callable[[], None]
) -> NDArray[np.int64]:
    """The samples in which something was seen in some chunks; all where they are too few for a pause."""
    if (samples[1] - samples[0]) * location.interval_s <= PAUSE_S:
        return np.arange(*samples)
    seen = [history.seen() for _, history in _sample_chunks(ctx, location, samples, check, PAUSE_CHUNKS)]
    return np.unique(np.concatenate([np.zeros(0, np.int64), *seen]))


def _sample_chunks(
    ctx: Context, location: LocationRecord, samples: tuple[int, int], check: Callable[[], None], n_chunks: int
) -> Iterator[tuple[int, History]]:
    """The numbers and histories of `n_chunks` chunks at most, spread evenly, that can be read."""
    for chunk in np.linspace(0, location.n_chunks - 1, min(location.n_chunks, n_chunks)).astype(int).tolist():
        check()
        with suppress(CorruptChunkError):
            yield chunk, read_compacted(ctx, location, chunk, *samples)

"""Sampling: some chunks and changing cells of a location, which stand for all of them in an update."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import CorruptChunkError
from tidemap.history.chunks import CHUNK_CELLS
from tidemap.history.history import History
from tidemap.services.context import Context
from tidemap.services.history import read_compacted
from tidemap.storage.records import LocationRecord


@dataclass(frozen=True, slots=True, eq=False)
class SampledCells:
    """Some changing cells (n,) of a location and their history; seen: the samples in which any of their chunks was."""

    cell: NDArray[np.int64]
    history: History
    seen: NDArray[np.int64]

    def thinned(self, n_cells: int) -> "SampledCells":
        """`n_cells` at most of the cells, or up to twice as many, spread evenly."""
        return self.every(max(1, len(self.cell) // n_cells))

    def every(self, step: int) -> "SampledCells":
        """The first of every `step` cells."""
        rows = np.arange(0, self.history.n_cells, step)
        return replace(self, cell=self.cell[rows], history=self.history.cells(rows))

    def seen_in(self, start: int, stop: int) -> NDArray[np.int64]:
        """The samples [start, stop) in which something was seen."""
        return self.seen[(self.seen >= start) & (self.seen < stop)]


Read = Callable[[Context, LocationRecord, int, int, int], History]
"""`read_compacted` or `read_history`."""


def sample_cells(
    ctx: Context,
    location: LocationRecord,
    samples: tuple[int, int],
    check: Callable[[], None],
    n_cells: int,
    *,
    until: int | None = None,
    read: Read = read_compacted,
) -> SampledCells:
    """About `n_cells` to four times as many cells that change before sample `until` (by default: at all), spread evenly
    over as many chunks that can be read and have compacted history."""
    with ctx.store.read() as work:
        chunks = work.segments.chunks(location.id)
    chunks = chunks if len(chunks) else np.arange(location.n_chunks)
    chunks = chunks[np.linspace(0, len(chunks) - 1, min(len(chunks), n_cells)).astype(int)]
    cells, seen = [np.zeros(0, np.int64)], np.zeros(0, np.int64)
    parts = [History.empty(0, samples[0], samples[1] - samples[0])]
    for chunk, history in _read_chunks(ctx, location, samples, check, chunks, read):
        changing = (history if until is None else history.window(samples[0], until)).changing()
        some = changing[:: max(1, len(changing) * len(chunks) // (4 * n_cells))]
        cells.append(chunk * CHUNK_CELLS + some)
        parts.append(history.cells(some))
        seen = np.union1d(seen, history.seen())
    return SampledCells(np.concatenate(cells), History.stack(parts), seen)


def measured(ctx: Context, location: LocationRecord, sampled: SampledCells, read: Read = read_compacted) -> History:
    """What was measured of sampled cells: without what is held after it."""
    history = sampled.history
    if location.hold_samples is None or not history.n_cells:
        return history
    as_read, window = replace(location, missing="mask"), (history.start, history.stop)
    chunks = sampled.cell // CHUNK_CELLS
    return History.stack(
        [
            read(ctx, as_read, chunk, *window).cells(sampled.cell[chunks == chunk] % CHUNK_CELLS)
            for chunk in np.unique(chunks).tolist()
        ]
    )


def _read_chunks(
    ctx: Context,
    location: LocationRecord,
    samples: tuple[int, int],
    check: Callable[[], None],
    chunks: NDArray[np.int64],
    read: Read,
) -> Iterator[tuple[int, History]]:
    """The numbers and histories of those chunks that can be read."""
    for chunk in chunks.tolist():
        check()
        with suppress(CorruptChunkError):
            yield chunk, read(ctx, location, chunk, *samples)

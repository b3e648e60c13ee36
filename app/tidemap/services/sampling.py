"""Sampling: the histories of some changing cells of a location, from which is learned what holds for all."""

from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np

from tidemap.errors import CorruptChunkError
from tidemap.history.history import History
from tidemap.services.context import Context
from tidemap.services.history import read_compacted
from tidemap.storage.records import LocationRecord

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
) -> History:
    """The histories of about `n_cells` to four times as many cells that change before sample `until` (by default: at
    all), spread evenly over some chunks that can be read."""
    n_chunks = min(location.n_chunks, n_cells)
    parts = [History.empty(0, samples[0], samples[1] - samples[0])]
    for history in sample_chunks(ctx, location, samples, check, n_chunks, read):
        changing = (history if until is None else history.window(samples[0], until)).changing()
        step = max(1, len(changing) * n_chunks // (4 * n_cells))
        parts.append(history.cells(changing[::step]))
    return History.stack(parts)


def sample_chunks(
    ctx: Context,
    location: LocationRecord,
    samples: tuple[int, int],
    check: Callable[[], None],
    n_chunks: int,
    read: Read = read_compacted,
) -> Iterator[History]:
    """The histories of `n_chunks` chunks at most, spread evenly, that can be read."""
    for chunk in np.linspace(0, location.n_chunks - 1, min(location.n_chunks, n_chunks)).astype(int).tolist():
        check()
        with suppress(CorruptChunkError):
            yield read(ctx, location, chunk, *samples)

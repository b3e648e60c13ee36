"""Observed map: what was seen last of every cell at a time, which needs no model."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tidemap.history.chunks import CHUNK_CELLS
from tidemap.history.history import NEVER, UNOBSERVED
from tidemap.services.context import Context
from tidemap.services.readings import last_seen
from tidemap.storage.records import LocationRecord

BLOCK = 16 * CHUNK_CELLS
"""Cells whose history is read before the next check."""


@dataclass(frozen=True, slots=True, eq=False)
class ObservedMap:
    """The cells that were observed at or before a time: cell, state and the start of its sample, (n,) each.

    unavailable: ranges [first, stop) of cells whose blobs are damaged; they look as if never observed.
    """

    cell: NDArray[np.int64]
    state: NDArray[np.uint8]
    time: NDArray[np.float64]
    unavailable: list[tuple[int, int]]


def observed_map(
    ctx: Context, location: LocationRecord, time: float, check: Callable[[], None] = lambda: None
) -> ObservedMap:
    """The map at a time (Unix seconds). `check` is called now and then, and ends it by raising."""
    state, sample = np.full(location.n_cells, UNOBSERVED, np.uint8), np.full(location.n_cells, NEVER, np.int64)
    damaged = list[int]()
    for cells in _blocks(location.n_cells):
        check()
        seen = last_seen(ctx, location, int(location.base.sample(time)), cells)
        state[cells], sample[cells] = seen.state, seen.sample
        damaged += seen.damaged
    cell = np.flatnonzero(state != UNOBSERVED)
    return ObservedMap(cell, state[cell], location.base.time(sample[cell]), location.cell_ranges(damaged))


def _blocks(n_cells: int) -> Iterator[NDArray[np.int64]]:
    for first in range(0, n_cells, BLOCK):
        yield np.arange(first, min(first + BLOCK, n_cells))

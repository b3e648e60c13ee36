"""Readings: what was read last of each cell, as it was known at a moment."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice, pairwise

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import CorruptChunkError
from tidemap.history.chunks import CHUNK_CELLS
from tidemap.history.history import NEVER, UNOBSERVED
from tidemap.history.runs import LatestRuns
from tidemap.services.context import Context
from tidemap.services.history import HistoryReader, read_backwards, read_times, reading
from tidemap.storage.records import LocationRecord

READ_AT_ONCE = 16
"""Chunks that are read in one moment of the database."""
ALWAYS = int(np.iinfo(np.int64).max)


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """The latest runs of some cells at or before a moment; those of `damaged` chunks look as if never read."""

    runs: LatestRuns
    damaged: list[int]


def readings_at(ctx: Context, location: LocationRecord, moment: float, cells: NDArray[np.int64]) -> Readings:
    """The latest readings at or before `moment` (Unix seconds) of some cells, ascending."""
    runs, damaged = LatestRuns.none(len(cells)), []
    for reader, chunk, rows in _chunks(ctx, location, cells):
        try:
            runs.put(rows, _of_chunk(reader, chunk, moment, cells[rows]))
        except CorruptChunkError:
            damaged.append(chunk)
    return Readings(runs, damaged)


def _chunks(
    ctx: Context, location: LocationRecord, cells: NDArray[np.int64]
) -> Iterator[tuple[HistoryReader, int, NDArray[np.int64]]]:
    """As `by_chunk`, each with what reads its history: to look at the location anew for every chunk takes longest."""
    chunks = by_chunk(cells)
    while some := list(islice(chunks, READ_AT_ONCE)):
        with reading(ctx, location) as reader:
            for chunk, rows in some:
                yield reader, chunk, rows


def by_chunk(cells: NDArray[np.int64]) -> Iterator[tuple[int, NDArray[np.int64]]]:
    """Each chunk that has some of the cells, which are ascending, and their rows."""
    chunks = cells // CHUNK_CELLS
    heads = np.flatnonzero(np.diff(chunks, prepend=-1)).tolist()
    for begin, stop in pairwise([*heads, len(cells)]):
        yield int(chunks[begin]), np.arange(begin, stop)


def _of_chunk(reader: HistoryReader, chunk: int, moment: float, cells: NDArray[np.int64]) -> LatestRuns:
    """The runs of some cells of one chunk."""
    location = reader.location
    local, sample = cells - chunk * CHUNK_CELLS, int(location.base.sample(moment))
    runs = _followed(reader, chunk, sample, local)
    if (later := read_later(reader.ctx, location, chunk, moment)) is not None:
        again = np.flatnonzero(later[local])
        runs.put(again, _followed(reader, chunk, sample - 1, local[again]))
    return runs


def _followed(reader: HistoryReader, chunk: int, sample: int, local: NDArray[np.int64]) -> LatestRuns:
    """The runs at or before a sample, followed back as far as some may be longer."""
    runs, open_ = LatestRuns.none(len(local)), np.arange(len(local))
    for piece in reader.backwards(chunk, sample) if len(local) else ():
        some = runs.cells(open_)
        some.extend(piece.cells(local[open_]), sample)
        runs.put(open_, some)
        open_ = open_[~some.whole]
        if not open_.size:
            break
    return runs


def held_until(
    ctx: Context, location: LocationRecord, moment: float, cells: NDArray[np.int64], since: NDArray[np.int64]
) -> NDArray[np.int64] | None:
    """(n,) the last sample in which what was read of cells, ascending, in the samples `since` (n,) may be held.

    That is the one before their sensor said that it is unavailable, as far as was known at a moment; ALWAYS of others.
    None where no sensor did. Of damaged chunks nothing is known.
    """
    until, sample = np.full(len(cells), ALWAYS), int(location.base.sample(moment))
    for chunk, rows in by_chunk(cells):
        rows = rows[since[rows] != NEVER]
        with suppress(CorruptChunkError):
            for piece in read_backwards(ctx, location, chunk, sample) if rows.size else ():
                for row in rows.tolist() if piece.ended is not None else ():
                    ends = piece.ends(int(cells[row]) - chunk * CHUNK_CELLS)
                    ends = ends[(ends >= since[row]) & (ends <= sample)]
                    if ends.size:
                        until[row] = min(until[row], ends[0] - 1)
                if piece.start <= since[rows].min():
                    break
    return until if (until < ALWAYS).any() else None


def read_later(ctx: Context, location: LocationRecord, chunk: int, moment: float) -> NDArray[np.bool_] | None:
    """Which cells of a chunk were read after `moment`, but in its sample; None where nothing was."""
    if location.last_time is None or location.last_time <= moment:
        return None
    with np.errstate(invalid="ignore"):
        return np.asarray(read_times(ctx, location, chunk, int(location.base.sample(moment))) > moment)


@dataclass(frozen=True, slots=True, eq=False)
class LastSeen:
    """state (n,) uint8 and sample (n,) int64: UNOBSERVED and NEVER where there is none, or its chunk is damaged."""

    state: NDArray[np.uint8]
    sample: NDArray[np.int64]
    damaged: list[int]


def last_seen(ctx: Context, location: LocationRecord, sample: int, cells: NDArray[np.int64]) -> LastSeen:
    """The latest measurement at or before `sample`, of some cells (ascending).

    Reads segments backwards, as far as some cell has not been found.
    """
    damaged = []
    state = np.full(len(cells), UNOBSERVED, np.uint8)
    seen = np.full(len(cells), NEVER, np.int64)
    for reader, chunk, missing in _chunks(ctx, location, cells):
        try:
            for piece in reader.backwards(chunk, sample):
                found, at = piece.last_seen(sample)
                local = cells[missing] - chunk * CHUNK_CELLS
                state[missing], seen[missing] = found[local], at[local]
                missing = missing[seen[missing] == NEVER]
                if not missing.size:
                    break
        except CorruptChunkError:
            damaged.append(chunk)
            state[missing] = UNOBSERVED
    return LastSeen(state, seen, damaged)

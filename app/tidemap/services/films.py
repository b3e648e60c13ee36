"""Films: what was last seen of every cell of a map, kept around the moments that are looked at and brought up to date.

Two kinds of window are kept of a location: the one of its latest readings, which moves on with them, and those of
earlier moments. To make one reads the history of every chunk; to move within it, or to follow a post, reads none.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import CorruptChunkError
from tidemap.history.bits import WORD
from tidemap.history.chunks import CHUNK_CELLS
from tidemap.history.combining import LATEST
from tidemap.history.film import Film, window_start
from tidemap.history.history import NEVER
from tidemap.history.measurements import Measurements
from tidemap.services.context import Context, KeptFilm, Seen
from tidemap.services.history import read_backwards
from tidemap.services.spectra import Fitted
from tidemap.storage.records import LocationRecord

MAX_WORDS: Final = 4
"""Words of 64 samples of a film, where it may take as much memory."""
FILMS: Final = 3
"""Films of one location that find room together."""
FEW: Final = 8
"""Up to this part of the cells, those that were read are asked for alone."""
CHECK_S: Final = 0.1
"""How often who waits for a turn looks whether it is still wanted."""
NOW: Final = "now"
Watch = Callable[[float], None]
"""Hears which share is done; what it raises ends the work."""


def seen_at(ctx: Context, location: LocationRecord, time: float) -> Seen | None:
    """What was last seen at or before the sample of a time; None where `make_film` has to be asked first."""
    sample = int(location.base.sample(time))
    for key in (NOW, window_start(sample, _words(ctx, location))):
        kept = ctx.caches.films.held((location.id, key), _version(location))
        if kept is None:
            continue
        with kept.lock:
            if _carry_over(ctx, location, kept, moving=key == NOW) and kept.film.start <= sample:
                return _shown(location, kept, sample)
    return None


def _shown(location: LocationRecord, kept: KeptFilm, sample: int) -> Seen:
    """What the film says, as before where nothing was read between the two moments."""
    last = kept.film.stop - 1
    if np.isfinite(kept.through):
        last = min(last, max(kept.film.start - 1, int(location.base.sample(kept.through))))
    at = min(sample, last)
    if kept.shown is None or kept.shown[:2] != (at, kept.number):
        kept.shown = (at, kept.number, _seen(kept, at))
        kept.since = np.zeros(location.n_cells, np.bool_) if at == last else None
    return kept.shown[2]


def _seen(kept: KeptFilm, sample: int) -> Seen:
    """What the film says; where only few cells were read since it was asked last, of those."""
    if kept.shown is not None and kept.since is not None and sample >= kept.shown[0]:
        cell = np.flatnonzero(kept.since)
        if cell.size <= kept.since.size // FEW:
            return kept.shown[2].replaced(cell, *kept.film.of(cell).at(sample))
    return Seen(*kept.film.at(sample))


def film_key(ctx: Context, location: LocationRecord, time: float) -> int | str:
    """Equal for moments that one film shows: the first sample of its window, or NOW."""
    sample = int(location.base.sample(time))
    return NOW if sample >= _latest(location) else window_start(sample, _words(ctx, location))


def make_film(ctx: Context, model: Fitted, time: float, watch: Watch = lambda _: None) -> Seen:
    """What `seen_at` has at hand from then on, where the film is small enough to be kept; called before every chunk,
    and while `MAX_MAKING` others are made, `watch` may end it. Who waited finds what others have made meanwhile."""
    while not ctx.caches.filming.acquire(timeout=CHECK_S):
        watch(0.0)
    try:
        return seen_at(ctx, model.location, time) or _made(ctx, model, time, watch)
    finally:
        ctx.caches.filming.release()


def small_film(ctx: Context, model: Fitted, time: float) -> Seen:
    """As `make_film` of a location with one cell, which takes no memory to speak of: it waits for no others."""
    return seen_at(ctx, model.location, time) or _made(ctx, model, time, lambda _: None)


def _made(ctx: Context, model: Fitted, time: float, watch: Watch) -> Seen:
    location, words = model.location, _words(ctx, model.location)
    key, latest = film_key(ctx, location, time), _latest(location)
    film = Film.blank(location.n_cells, _moving_start(latest, words) if isinstance(key, str) else key, words)
    known = np.zeros(location.n_cells, np.bool_)
    known[model.loaded.known] = True
    for chunk in range(location.n_chunks):
        watch(chunk / location.n_chunks)
        _lay_chunk(ctx, location, film, chunk, known[chunk * CHUNK_CELLS :])
    seen = Seen(*film.at(int(location.base.sample(time))))
    kept = KeptFilm(film, location.observation_seq, -np.inf if location.last_time is None else location.last_time)
    ctx.caches.films.drop(lambda other: other == (location.id, key))
    ctx.caches.films.get((location.id, key), _version(location), lambda: kept)
    return seen


def _words(ctx: Context, location: LocationRecord) -> int:
    """As many as let FILMS of them be kept, but at least one."""
    room = ctx.settings.history_cache_bytes // FILMS // location.n_cells - 19
    return max(1, min(room // 16, MAX_WORDS))


def _version(location: LocationRecord) -> tuple[object, ...]:
    """What a film cannot follow."""
    return location.deleted, location.combine


def _latest(location: LocationRecord) -> int:
    return int(location.base.sample(location.base.epoch if location.last_time is None else location.last_time))


def _moving_start(latest: int, words: int) -> int:
    """So that some of what was before the latest sample is in the window, and some of what comes."""
    return (latest // WORD - words // 2) * WORD


def _lay_chunk(ctx: Context, location: LocationRecord, film: Film, chunk: int, known: NDArray[np.bool_]) -> None:
    """What history says of a chunk: nothing where it is damaged. known: of its cells, those that were ever seen."""
    first, n_cells = chunk * CHUNK_CELLS, location.chunk_size(chunk)
    rows = slice(first, first + n_cells)
    film.clear(first, n_cells)
    try:
        for piece in read_backwards(ctx, location, chunk, film.stop - 1):
            film.lay(first, piece)
            if piece.start < film.start and not (known[:n_cells] & (film.sample[rows] == NEVER)).any():
                return
    except CorruptChunkError:
        film.clear(first, n_cells)


def _carry_over(ctx: Context, location: LocationRecord, kept: KeptFilm, moving: bool) -> bool:
    """Take in what was posted since; False where that is compacted by now, or damaged."""
    if kept.number >= location.observation_seq:
        return True
    with ctx.store.read() as work:
        if work.locations.by_id(location.id).compacted_seq > kept.number:
            return False
        tail = work.observations.tail(replace(location, compacted_seq=kept.number))
    if tail.damage:
        return False
    for _, part in tail.parts:
        if len(part):
            _take_in(ctx, location, kept, part, moving)
    kept.number = location.observation_seq
    return True


def _take_in(ctx: Context, location: LocationRecord, kept: KeptFilm, part: Measurements, moving: bool) -> None:
    """One observation. What may not simply be put over what is there is read anew, by chunk."""
    film, sample = kept.film, np.asarray(location.base.sample(part.time), np.int64)
    if moving and sample.max() >= film.stop:
        film.wind(_moving_start(int(sample.max()), film.observed.shape[1]))
    within, before = (sample >= film.start) & (sample < film.stop), sample < film.start
    newer = location.combine == LATEST and float(part.time.min()) > kept.through
    alone = newer or not film.holds(part.cell[within], sample[within]).any()
    if alone and _distinct(part.cell):
        film.put(part.cell[within], sample[within], part.state[within])
        again = part.cell[before & (sample >= film.sample[part.cell])]
    else:
        again = part.cell[within | before]
    if again.size:
        kept.since = None
    elif kept.since is not None:
        kept.since[part.cell[within]] = True
    for chunk in np.unique(again // CHUNK_CELLS).tolist():
        rows = slice(chunk * CHUNK_CELLS, (chunk + 1) * CHUNK_CELLS)
        known = film.sample[rows] != NEVER
        known[again[again // CHUNK_CELLS == chunk] % CHUNK_CELLS] = True
        _lay_chunk(ctx, location, film, chunk, known)
    kept.through = max(kept.through, float(part.time.max()))


def _distinct(cell: NDArray[np.uint32]) -> bool:
    """Whether no cell comes twice; a snapshot's are ascending."""
    return bool((cell[1:] > cell[:-1]).all()) or len(np.unique(cell)) == len(cell)

"""Context: what every use case works on."""

import os
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from threading import BoundedSemaphore, Lock

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from tidemap.errors import CorruptChunkError
from tidemap.events.bus import Bus
from tidemap.history.film import Film
from tidemap.history.history import History
from tidemap.history.runs import UNKNOWN_BEFORE, RunsBefore
from tidemap.services.buffer_pool import BufferPool
from tidemap.services.caches import ByteCache
from tidemap.services.damage import Damage
from tidemap.services.location_cache import LocationCache
from tidemap.services.state_buffer import StateBuffer
from tidemap.settings import Settings
from tidemap.space.alignment import Surface
from tidemap.spectral.belief import Beliefs
from tidemap.spectral.conditioning import Evidence
from tidemap.spectral.prediction import known
from tidemap.spectral.spectrum import Spectrum
from tidemap.storage.records import RevisionRecord
from tidemap.storage.repositories.observations import Tail
from tidemap.storage.store import Store

MAX_MAKING = 2
"""Films that one process makes at a time: each takes memory before the cache bounds it."""


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Loaded:
    """A spectrum of all cells of a location; those of the chunks in `damage` are blank, as if never observed.

    `revision` is the one it is of, or that one as if it had been fitted so. known: the cells that have been observed.
    """

    revision: RevisionRecord
    spectrum: Spectrum
    damage: Mapping[int, CorruptChunkError]
    known: NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "known", known(self.spectrum))


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class KeptEvidence:
    """What was read last of some cells, or is believed of them; those of `damaged` chunks look as if never read.

    until (n,): the last sample in which that may be held, as the sensor was unavailable then; None where none was.
    before: where the run of what was read last has one sample only, what is known of the run before it.
    digest: of the cells, where all of a location are kept.
    """

    evidence: Evidence | Beliefs
    damaged: list[int]
    until: NDArray[np.int64] | None = None
    before: RunsBefore = UNKNOWN_BEFORE
    digest: bytes = b""

    def rows(self, rows: NDArray[np.int64]) -> "KeptEvidence":
        """The same of some rows."""
        until = None if self.until is None else self.until[rows]
        return KeptEvidence(self.evidence.rows(rows), self.damaged, until)


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What was last seen of every cell, (n_cells,) each, to be read only: UNOBSERVED and NEVER where there is none."""

    state: NDArray[np.uint8]
    sample: NDArray[np.int64]

    def replaced(self, cell: NDArray[np.integer], state: NDArray[np.uint8], sample: NDArray[np.int64]) -> "Seen":
        """The same but for some cells (m,)."""
        new = Seen(self.state.copy(), self.sample.copy())
        new.state[cell], new.sample[cell] = state, sample
        return new


@dataclass(slots=True, eq=False)
class KeptFilm:
    """A film with all observations through `number`; the latest of them is of `through` (Unix seconds).

    shown: a sample and a number, and what was last seen then. since (n_cells,): what was read since, where all that was
    read before is shown; None where that is not so.
    """

    film: Film
    number: int
    through: float
    shown: tuple[int, int, Seen] | None = None
    since: NDArray[np.bool_] | None = None
    lock: Lock = field(default_factory=Lock)

    @property
    def nbytes(self) -> int:
        """The memory it takes, with what was last seen."""
        return self.film.nbytes + 2 * self.film.state.nbytes + self.film.sample.nbytes


@dataclass(frozen=True, slots=True, kw_only=True)
class Caches:
    """What one process keeps of the database, each bounded in bytes.

    To unpack what `tails` is to keep, hold `reading_on`.
    """

    spectra: ByteCache[Loaded]
    histories: ByteCache[History]
    tails: ByteCache[Tail]
    evidence: ByteCache[KeptEvidence]
    surfaces: ByteCache[Surface]
    films: ByteCache[KeptFilm]
    buffers: BufferPool[StateBuffer]
    locations: LocationCache = field(default_factory=LocationCache)
    reading_on: Lock = field(default_factory=Lock)
    filming: BoundedSemaphore = field(default_factory=lambda: BoundedSemaphore(MAX_MAKING))

    @classmethod
    def of(cls, settings: Settings) -> "Caches":
        """Empty ones, as large as the settings say."""
        return cls(
            spectra=ByteCache(settings.spectrum_cache_bytes, _loaded_bytes),
            histories=ByteCache(
                settings.history_cache_bytes, lambda value: value.observed.nbytes + value.occupied.nbytes
            ),
            tails=ByteCache(settings.history_cache_bytes // 2, tail_bytes),
            evidence=ByteCache(settings.reading_cache_bytes, lambda kept: kept.evidence.nbytes + kept.before.nbytes),
            surfaces=ByteCache(settings.surface_cache_bytes, lambda surface: surface.nbytes),
            films=ByteCache(settings.history_cache_bytes, lambda kept: kept.nbytes),
            buffers=BufferPool(settings.answer_cache_bytes),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Context:
    """What one process works with. `clock` gives Unix seconds; `term` is the leader's term that its writes belong to.

    To compact or forget a history, hold `compacting`: the segments that are read are written later.
    """

    settings: Settings
    store: Store
    bus: Bus
    caches: Caches
    damage: Damage
    compacting: Lock
    parsing: ThreadPoolExecutor
    clock: Callable[[], float]
    term: int | None = None


@contextmanager
def open_context(settings: Settings, clock: Callable[[], float] = time.time) -> Iterator[Context]:
    """A context on a migrated database; closes it, finishing the writes that were taken.

    From then on matrix libraries of this process work on one thread: what we do in parallel has threads of its own, and
    theirs would wait for one another, on a busy machine ten times as long as they compute.
    """
    threadpool_limits(1, user_api="blas")
    store = Store(settings.url, settings.commit_queue, settings.commit_batch)
    # Posts that are parsed and judged at once: more threads than processors would only take turns.
    parsing = ThreadPoolExecutor(os.cpu_count() or 1, "tidemap-posts")
    try:
        yield Context(
            settings=settings,
            store=store,
            bus=Bus(),
            caches=Caches.of(settings),
            damage=Damage(),
            compacting=Lock(),
            parsing=parsing,
            clock=clock,
        )
    finally:
        parsing.shutdown()
        store.close()


def _loaded_bytes(loaded: Loaded) -> int:
    return spectrum_bytes(loaded.spectrum) + loaded.known.nbytes


def tail_bytes(tail: Tail) -> int:
    """Memory of the measurements of a log's tail."""
    return sum(part.nbytes for _, part in tail.parts)


def spectrum_bytes(spectrum: Spectrum) -> int:
    """Memory of a spectrum's arrays."""
    arrays = (spectrum.frequency_hz, spectrum.gate, spectrum.mean, spectrum.cell, spectrum.index)
    return sum(array.nbytes for array in arrays) + spectrum.coefficient.nbytes

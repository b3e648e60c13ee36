"""Context: what every use case works on."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from app.events.bus import Bus
from app.services.caches import ByteCache
from app.settings import Settings
from app.spectral.history import History
from app.spectral.measurements import Measurements
from app.spectral.spectrum import Spectrum
from app.storage.store import Store


@dataclass(frozen=True, slots=True)
class Context:
    """The store, the bus and the caches of one process. `clock` gives Unix seconds."""

    settings: Settings
    store: Store
    bus: Bus
    spectra: ByteCache[Spectrum]
    histories: ByteCache[History]
    tails: ByteCache[Measurements]
    clock: Callable[[], float]


@contextmanager
def open_context(settings: Settings, clock: Callable[[], float] = time.time) -> Iterator[Context]:
    """A context on a migrated database; closes it, finishing the writes that were taken."""
    store = Store(settings.url, settings.commit_queue, settings.commit_batch)
    try:
        yield Context(
            settings,
            store,
            Bus(),
            ByteCache(settings.spectrum_cache_bytes, spectrum_bytes),
            ByteCache(settings.history_cache_bytes, lambda value: value.observed.nbytes + value.occupied.nbytes),
            ByteCache(settings.history_cache_bytes // 4, lambda value: 13 * len(value)),
            clock,
        )
    finally:
        store.close()


def spectrum_bytes(spectrum: Spectrum) -> int:
    """Memory of a spectrum's arrays."""
    arrays = (spectrum.frequency_hz, spectrum.gate, spectrum.mean, spectrum.cell, spectrum.index)
    return sum(array.nbytes for array in arrays) + spectrum.coefficient.nbytes

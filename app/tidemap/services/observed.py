"""Observed: what was last seen of cells at a time, from what is kept of each, else from history."""

from collections.abc import Hashable
from dataclasses import dataclass
from weakref import ref

import numpy as np
from numpy.typing import NDArray

from tidemap.history.chunks import CHUNK_CELLS
from tidemap.history.history import NEVER, UNOBSERVED
from tidemap.history.segment import SEGMENT_SAMPLES
from tidemap.services.context import Context, KeptEvidence
from tidemap.services.history import window
from tidemap.services.kept import kept_evidence
from tidemap.services.readings import LastSeen, last_seen
from tidemap.services.spectra import Fitted, fitted, held_fit
from tidemap.spectral.conditioning import EVIDENCE_BYTES, Evidence


def observed_at(ctx: Context, model: Fitted, cells: NDArray[np.int64], time: float) -> LastSeen:
    """The latest measurement of some cells, ascending, in samples up to the one of a time.

    Where the time is that of the latest measurement of all or later it is what is kept of each cell; of an earlier
    time history is asked for the cells that were read since. Of a location whose sensor errs a belief is kept, and no
    reading: history is asked for all.
    """
    sample = int(model.location.base.sample(time))
    kept = _kept(ctx, model, cells, sample)
    if kept is None or not isinstance(kept.evidence, Evidence):
        return last_seen(ctx, model.location, sample, cells)
    found = _forgotten(kept.evidence, _first_sample(ctx, model))
    rest = np.flatnonzero(np.isin(cells // CHUNK_CELLS, kept.damaged)) if kept.damaged else np.zeros(0, np.int64)
    return _with(found, rest, last_seen(ctx, model.location, sample, cells[rest])) if rest.size else found


@dataclass(frozen=True, slots=True, eq=False)
class MapSeen:
    """What is kept of all cells of a model that were ever observed; what is before sample `first` is forgotten."""

    kept: KeptEvidence
    evidence: Evidence
    first: int

    @property
    def version(self) -> tuple[Hashable, ...]:
        """Equal where the same was seen."""
        return ref(self.kept), self.first

    def last_seen(self) -> LastSeen:
        """The latest measurement of each cell."""
        return _forgotten(self.evidence, self.first)


def map_seen(ctx: Context, model: Fitted, time: float) -> MapSeen | None:
    """What was last seen of all cells at a time, as `observed_at`; None where not all of that is kept."""
    kept = _kept(ctx, model, model.loaded.known, int(model.location.base.sample(time)))
    if kept is None or kept.damaged or not isinstance(kept.evidence, Evidence):
        return None
    return MapSeen(kept, kept.evidence, _first_sample(ctx, model))


def _kept(ctx: Context, model: Fitted, cells: NDArray[np.int64], sample: int) -> KeptEvidence | None:
    """What is kept of the cells with the location's own fit, whatever the answer's is; None where it is not worth
    being loaded, as it is of another time or would not be kept."""
    location, latest = model.location, model.location.last_time
    if latest is None or location.sensor is not None or sample < location.base.sample(latest):
        return None
    if model.chunks is not None:
        return None
    if not ctx.caches.evidence.takes(EVIDENCE_BYTES * len(cells)):
        return None
    # The location as it was when the question began: what came in since is for the next one.
    own = held_fit(ctx, model.location) or fitted(ctx, model.location.name).loaded
    return kept_evidence(ctx, Fitted(model.location, own), cells)


def _first_sample(ctx: Context, model: Fitted) -> int:
    """The first sample of the first segment that is modelled: a search ends there."""
    return window(ctx, model.location)[0] // SEGMENT_SAMPLES * SEGMENT_SAMPLES


def _forgotten(kept: Evidence, first: int) -> LastSeen:
    """What is kept as measurements, without those before sample `first`."""
    state, sample = kept.state, kept.sample
    old = sample < first
    if old.any():
        state, sample = np.where(old, np.uint8(UNOBSERVED), state), np.where(old, NEVER, sample)
    return LastSeen(state, sample, [])


def _with(found: LastSeen, rows: NDArray[np.int64], other: LastSeen) -> LastSeen:
    """The same with other measurements of some rows."""
    state, sample = found.state.copy(), found.sample.copy()
    state[rows], sample[rows] = other.state, other.sample
    return LastSeen(state, sample, other.damaged)

"""Kept: what was read last of each cell, kept from question to question, and renewed by what came in since."""

from dataclasses import dataclass, replace
from hashlib import blake2b
from typing import cast

import numpy as np
from numpy.typing import NDArray

from tidemap.history.combining import LATEST
from tidemap.history.history import NEVER, OCCUPIED, UNOBSERVED
from tidemap.history.measurements import Measurements
from tidemap.history.runs import UNKNOWN_BEFORE, LaterReadings, LatestRuns
from tidemap.services.beliefs import beliefs_at, detector_of
from tidemap.services.context import Context, KeptEvidence
from tidemap.services.history import window
from tidemap.services.readings import ALWAYS, held_until, readings_at
from tidemap.services.spectra import Fitted, held_fit
from tidemap.spectral.belief import Beliefs
from tidemap.spectral.conditioning import Evidence
from tidemap.storage.records import LocationRecord, SensorSetting

MAX_AGE = 2**32 - 1
"""Samples, as far as ages are counted."""
SHARE_BEFORE, MIN_BEFORE_BYTES = 8, 4096
"""The part of what evidence takes that `before` may take, and what it may take anyway."""
MAX_READ_ON = 64
"""Measurements of a cell that are followed one by one; of more, history is read."""


def found_evidence(ctx: Context, model: Fitted, cells: NDArray[np.int64], moment: float) -> KeptEvidence:
    """What history says of some cells at a moment."""
    return _bounded(ctx, model, cells, moment, _in_history(ctx, model, cells, moment))


def _in_history(ctx: Context, model: Fitted, cells: NDArray[np.int64], moment: float) -> KeptEvidence:
    """The same, held for ever."""
    detector, first = detector_of(model), model.location.first_time
    if detector is None:
        readings = readings_at(ctx, model.location, moment, cells)
        return KeptEvidence(_evidence(model, cells, readings.runs), readings.damaged)
    nothing = Beliefs.none(len(cells), detector)
    if first is None or moment < first:
        return KeptEvidence(nothing, [])
    return beliefs_at(ctx, model, cells, moment, nothing)


def _evidence(model: Fitted, cells: NDArray[np.int64], runs: LatestRuns) -> Evidence:
    """What the latest runs of some cells say."""
    age = np.where(runs.known, runs.sample - np.where(runs.known, runs.begin, 0) + 1, 0)
    likely = _likelihood(model, cells, runs)
    return Evidence(runs.state, runs.sample, np.minimum(age, MAX_AGE).astype(np.uint32), likely)


def _bounded(ctx: Context, model: Fitted, cells: NDArray[np.int64], moment: float, kept: KeptEvidence) -> KeptEvidence:
    """What is kept, held no longer than until sensors said that they are unavailable."""
    if not model.location.hold_samples:
        return kept
    return replace(kept, until=held_until(ctx, model.location, moment, cells, kept.evidence.sample))


def _likelihood(model: Fitted, cells: NDArray[np.int64], runs: LatestRuns) -> NDArray[np.float32]:
    """(n,) the model's probability of each reading when it was read; 1 where there is none."""
    likely = np.ones(len(cells), np.float32)
    order = np.argsort(runs.sample, kind="stable")
    order = order[runs.known[order]]
    sample = runs.sample[order]
    for rows in np.split(order, np.flatnonzero(np.diff(sample)) + 1) if order.size else ():
        time = float(model.location.base.time(runs.sample[rows[0]]))
        p = model.predict(time, cells[rows])
        likely[rows] = np.where(runs.state[rows] == OCCUPIED, p, 1 - p)
    return likely


@dataclass(frozen=True, slots=True)
class _Version:
    """Evidence is out of date where one of these has changed: where only how many observations there are and what time
    they reach, in some cells; where only the revision has, in how likely the readings were."""

    revision: int
    observations: int
    last_time: float | None
    first_time: float | None
    deleted: int
    sensor: SensorSetting | None
    hold_samples: int | None

    def renews(self, old: "_Version") -> bool:
        """Whether what is kept of an older version can be renewed."""
        same = replace(old, revision=self.revision, observations=self.observations, last_time=self.last_time) == self
        return same and old.observations <= self.observations


def kept_evidence(ctx: Context, model: Fitted, cells: NDArray[np.int64]) -> KeptEvidence | None:
    """What is kept of the latest readings of these cells; None where it is neither kept nor worth being kept.

    Nothing is of a part of a location.
    """
    if model.chunks is not None:
        return None
    location = model.location
    whole = model.loaded.known
    key = (location.id, model.revision.recipe)
    counted = (location.observation_seq, location.last_time, location.first_time, location.deleted)
    version = _Version(model.revision.revision, *counted, location.sensor, location.hold_samples)
    if len(cells) < len(whole):
        held = ctx.caches.evidence.held(key, version)
        rows, there = _rows(whole, cells)
        return held.rows(rows) if held is not None and there.all() else None
    if cells is not whole and not np.array_equal(whole, cells):
        return None
    return ctx.caches.evidence.get(key, version, lambda: _renewed(ctx, model, cells, version))


def keep_up(ctx: Context, location: LocationRecord) -> None:
    """Renew what is kept of a location, as somebody may ask, before the log that says what was read goes."""
    loaded = held_fit(ctx, location)
    if loaded is not None and ctx.caches.evidence.latest((location.id, loaded.revision.recipe)) is not None:
        kept_evidence(ctx, Fitted(location, loaded), loaded.known)


def _renewed(ctx: Context, model: Fitted, cells: NDArray[np.int64], version: _Version) -> KeptEvidence:
    """What is kept of an earlier version with what was read since; all of it read anew where that cannot be told."""
    location = model.location
    held = ctx.caches.evidence.latest((location.id, model.revision.recipe))
    if held is not None:
        old, kept = cast(_Version, held[0]), held[1]
        if version.renews(old) and not kept.damaged:
            refitted = kept if old.revision == version.revision else _refitted(model, kept, cells)
            since = _since(ctx, location, old.observations)
            if refitted is not None and since is not None:
                return _moved(_Renewal(ctx, model, cells, old.last_time), refitted, since)
    moment = location.base.epoch if version.last_time is None else version.last_time
    return replace(found_evidence(ctx, model, cells, moment), digest=_digest(cells))


def _refitted(model: Fitted, kept: KeptEvidence, cells: NDArray[np.int64]) -> KeptEvidence | None:
    """What is kept of all cells, as likely as another revision says; None where that changes all of it."""
    if isinstance(kept.evidence, Beliefs) or kept.digest != _digest(cells):
        return None
    return replace(kept, evidence=_evidence(model, cells, _runs(kept.evidence)))


def _digest(cells: NDArray[np.int64]) -> bytes:
    """By which other cells are told apart."""
    return blake2b(cells.tobytes(), digest_size=16).digest()


def _since(ctx: Context, location: LocationRecord, number: int) -> Measurements | None:
    """What was posted after an observation; None where some of it is compacted by now."""
    with ctx.store.read() as work:
        if work.locations.by_id(location.id).compacted_seq > number:
            return None
        tail = work.observations.tail(replace(location, compacted_seq=number))
    return Measurements.concatenate([part for _, part in tail.parts])


@dataclass(frozen=True, slots=True, eq=False)
class _Renewal:
    """Of what is kept of some cells, when the latest measurement that it knows of was made at `last_time`."""

    ctx: Context
    model: Fitted
    cells: NDArray[np.int64]
    last_time: float | None

    def some(self, rows: NDArray[np.int64]) -> "_Renewal":
        """Of some of the cells."""
        return replace(self, cells=self.cells[rows])

    def in_history(self) -> KeptEvidence:
        """What history says by now, held for ever."""
        return _in_history(self.ctx, self.model, self.cells, self.latest)

    def bounded(self, kept: KeptEvidence) -> KeptEvidence:
        """What is kept, held no longer than it may be."""
        return _bounded(self.ctx, self.model, self.cells, self.latest, kept)

    @property
    def latest(self) -> float:
        """When the latest measurement of all was made."""
        return cast(float, self.model.location.last_time)


def _moved(renewal: _Renewal, kept: KeptEvidence, since: Measurements) -> KeptEvidence:
    """What is kept, and what was read since."""
    touched, index = np.unique(since.cell, return_inverse=True)
    rows, mine = _rows(renewal.cells, touched)
    some = renewal.some(rows)
    if isinstance(kept.evidence, Beliefs):
        first = np.full(len(touched), np.inf)
        np.minimum.at(first, index, since.time)
        new = some.bounded(_believed(some, kept.evidence.rows(rows), first[mine]))
        believed = kept.evidence.replaced(rows, cast(Beliefs, new.evidence))
        return KeptEvidence(believed, new.damaged, _replaced(kept, rows, new), digest=kept.digest)
    before = kept.before.of(rows)
    new = some.bounded(_read_on(some, kept.evidence.rows(rows), before, since))
    evidence = kept.evidence.replaced(rows, cast(Evidence, new.evidence))
    runs_before = kept.before.replaced(rows, before)
    if runs_before.nbytes > max(MIN_BEFORE_BYTES, evidence.nbytes // SHARE_BEFORE):
        runs_before = UNKNOWN_BEFORE
    return KeptEvidence(evidence, new.damaged, _replaced(kept, rows, new), runs_before, kept.digest)


def _believed(renewal: _Renewal, before: Beliefs, first: NDArray[np.float64]) -> KeptEvidence:
    """Beliefs, and what was read since, first at times (n,); late readings are filtered anew with all before them."""
    late = np.flatnonzero(renewal.model.location.base.sample(first) <= before.sample)
    before.put(late, Beliefs.none(len(late), before.detector))
    return beliefs_at(renewal.ctx, renewal.model, renewal.cells, renewal.latest, before)


def _read_on(renewal: _Renewal, evidence: Evidence, before: NDArray[np.int64], since: Measurements) -> KeptEvidence:
    """Evidence, and what was read since; where that does not say enough of a cell, what history says.

    before (n,): as of `LatestRuns.read_on`.
    """
    cells, location = renewal.cells, renewal.model.location
    row, mine = _rows(cells, since.cell)
    since = since.select(mine)
    earlier = since.time <= (-np.inf if renewal.last_time is None else renewal.last_time)
    lost = np.bincount(row, minlength=len(cells)) > MAX_READ_ON
    lost[row[earlier | ~since.says()]] = True
    if location.combine != LATEST:
        lost[:] = True
    runs, going = _runs(evidence), ~lost[row]
    some = since.select(going)
    lost |= runs.read_on(LaterReadings.latest(row[going], some.samples(location.base), some.time, some.state), before)
    # Older ones are not modelled any more, and a run begins with what is.
    lost |= (evidence.age == MAX_AGE) | (runs.known & (runs.begin < window(renewal.ctx, location)[0]))
    rest = np.flatnonzero(lost)
    before[rest] = NEVER
    new = _evidence(renewal.model, cells, runs)
    if not rest.size:
        return KeptEvidence(new, [])
    found = renewal.some(rest).in_history()
    return KeptEvidence(new.replaced(rest, cast(Evidence, found.evidence)), found.damaged)


def _rows(cells: NDArray[np.int64], some: NDArray[np.integer]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Where some cells are among others, which are ascending, and which of them are there at all, (n,)."""
    row = np.searchsorted(cells, some)
    there = cells[np.minimum(row, len(cells) - 1)] == some if len(cells) else np.zeros(len(some), np.bool_)
    return row[there], there


def _runs(evidence: Evidence) -> LatestRuns:
    """The runs that some evidence is made of."""
    begin = np.where(evidence.state == UNOBSERVED, NEVER, evidence.sample - evidence.age.astype(np.int64) + 1)
    return LatestRuns(evidence.state, evidence.sample, begin, np.ones(len(begin), np.bool_))


def _replaced(kept: KeptEvidence, rows: NDArray[np.int64], new: KeptEvidence) -> NDArray[np.int64] | None:
    """Until when what is kept may be held, that of some rows replaced."""
    if kept.until is None and new.until is None:
        return None
    until = np.full(len(kept.evidence.sample), ALWAYS) if kept.until is None else kept.until.copy()
    until[rows] = ALWAYS if new.until is None else new.until
    return until

"""Given: the probability of cells, given what was read of them last (DESIGN 2.8)."""

from dataclasses import dataclass, replace
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray

from tidemap.history.chunks import CHUNK_CELLS
from tidemap.history.history import OCCUPIED
from tidemap.services.beliefs import beliefs_at, detector_of
from tidemap.services.context import Context, KeptEvidence
from tidemap.services.history import read_times
from tidemap.services.readings import ALWAYS, Readings, held_until, readings_at
from tidemap.services.spectra import Fitted
from tidemap.spectral.belief import Beliefs
from tidemap.spectral.conditioning import Evidence, Standing
from tidemap.spectral.persistence import differing
from tidemap.spectral.state_columns import Conditioning
from tidemap.storage.records import LocationRecord, SensorSetting

Given = Literal["observations", "model"]
"""What an answer is conditioned on: what was read last of each cell, or nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """What was read of some cells (n,) at or before a moment, as evidence for later times.

    Those of `damaged` chunks look as if never read. until: as of KeptEvidence.
    """

    ctx: Context
    model: Fitted
    cell: NDArray[np.int64]
    evidence: Evidence | Beliefs
    damaged: list[int]
    standing: Standing
    until: NDArray[np.int64] | None = None

    def condition(self, probability: NDArray[np.float32], time: NDArray[np.float64]) -> NDArray[np.float32]:
        """The model's p (n, m) at times (m,), conditioned where a time is later than a cell's reading."""
        found = self._conditioned(probability, self.model.location.base.sample(time))
        row, column = self._read_later(time)
        found[row, column] = self.evidence.unread(probability[row, column])
        return found

    def conditioning(self, time: float) -> Conditioning:
        """What conditions the model's p of some rows at one time as `condition` does."""
        row, _ = self._read_later(np.array([time]))
        evidence = self.evidence.without(row) if row.size else self.evidence
        sample = self.model.location.base.sample(np.array([time]))

        def some(rows: slice, probability: NDArray[np.float32], out: NDArray[np.float32]) -> None:
            until = None if self.until is None else self.until[rows]
            known = replace(self, cell=self.cell[rows], evidence=evidence.part(rows), until=until)
            known._conditioned(probability[:, np.newaxis], sample, out[:, np.newaxis])

        return some

    def _read_later(self, time: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Rows and columns of the cells and times (m,) where a reading is in the sample of the time but not earlier."""
        location = self.model.location
        # Later than all that was ever measured is later than every reading.
        early = np.flatnonzero(time <= (-np.inf if location.last_time is None else location.last_time))
        row, column = np.nonzero(self.evidence.sample[:, np.newaxis] == location.base.sample(time[early]))
        later = ~(self._read_at(row) < time[early[column]]) if row.size else np.zeros(0, np.bool_)
        return row[later], early[column[later]]

    def _conditioned(
        self, probability: NDArray[np.float32], sample: NDArray[np.int64], out: NDArray[np.float32] | None = None
    ) -> NDArray[np.float32]:
        """The same by samples; what sensors ended at different times is conditioned apart.

        Written to `out` where that is given, as `Evidence.condition` takes it.
        """
        if self.until is None:
            return self._alike(probability, sample, out)
        found = np.empty(probability.shape, np.float32) if out is None else out
        for last in np.unique(self.until).tolist():
            rows = np.flatnonzero(self.until == last)
            standing = replace(self.standing, limit=min(self.standing.limit, last))
            found[rows] = replace(self.rows(rows), standing=standing)._alike(probability[rows], sample)
        return found

    def _alike(
        self, probability: NDArray[np.float32], sample: NDArray[np.int64], out: NDArray[np.float32] | None = None
    ) -> NDArray[np.float32]:
        """The same of cells that stand alike."""
        if isinstance(self.evidence, Beliefs):
            return self.evidence.condition(probability, sample, self.standing, out)
        interval_s, revision = self.model.location.interval_s, self.model.revision
        if not revision.offset:
            return self.evidence.condition(probability, sample, interval_s, revision.persistence, self.standing, out)
        own = np.array([revision.offset.get(cell, 0.0) for cell in self.cell.tolist()])
        found = np.empty(probability.shape, np.float32) if out is None else out
        for offset in np.unique(own).tolist():
            rows, persistence = np.flatnonzero(own == offset), differing(revision.persistence, offset)
            some = self.evidence.rows(rows)
            found[rows] = some.condition(probability[rows], sample, interval_s, persistence, self.standing)
        return found

    def at(self, probability: NDArray[np.float32], time: float) -> NDArray[np.float32]:
        """The model's p (n,) at one time, conditioned as in `condition`."""
        return self.condition(probability[:, np.newaxis], np.array([time]))[:, 0]

    def rows(self, rows: NDArray[np.int64]) -> "Known":
        """The same of some rows, in any order."""
        until = None if self.until is None else self.until[rows]
        return replace(self, cell=self.cell[rows], evidence=self.evidence.rows(rows), until=until)

    def _read_at(self, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """When the cells of some rows were read, to the last bit."""
        found = np.full(len(self.cell), np.nan)
        pairs = np.stack((self.cell[rows] // CHUNK_CELLS, self.evidence.sample[rows]))
        for chunk, sample in np.unique(pairs, axis=1).T.tolist():
            mine = rows[(pairs[0] == chunk) & (pairs[1] == sample)]
            times = read_times(self.ctx, self.model.location, chunk, sample)
            found[mine] = times[self.cell[mine] - chunk * CHUNK_CELLS]
        return found[rows]


def known_at(ctx: Context, model: Fitted, cells: NDArray[np.int64], moment: float) -> Known:
    """What was known of some cells, ascending, at a moment (Unix seconds)."""
    location = model.location
    kept = None
    if location.last_time is None or moment >= location.last_time:
        kept = kept_evidence(ctx, model, cells)
    if kept is None:
        kept = _found(ctx, model, cells, moment)
    limit = int(location.base.sample(min(moment, ctx.clock())))
    standing = Standing(location.hold_samples or 0, limit)
    return Known(ctx, model, cells, kept.evidence, kept.damaged, standing, kept.until)


def _found(ctx: Context, model: Fitted, cells: NDArray[np.int64], moment: float) -> KeptEvidence:
    """What history says of some cells at a moment."""
    detector, first = detector_of(model), model.location.first_time
    if detector is not None:
        nothing = Beliefs.none(len(cells), detector)
        if first is None or moment < first:
            return KeptEvidence(nothing, [])
        return _bounded(ctx, model, cells, moment, beliefs_at(ctx, model, cells, moment, nothing))
    readings = readings_at(ctx, model.location, moment, cells)
    runs = readings.runs
    age = np.where(readings.known, runs.sample - np.where(readings.known, runs.begin, 0) + 1, 0)
    likely = _likelihood(model, cells, readings)
    evidence = Evidence(runs.state, runs.sample, np.minimum(age, 2**32 - 1).astype(np.uint32), likely)
    return _bounded(ctx, model, cells, moment, KeptEvidence(evidence, readings.damaged))


def _bounded(ctx: Context, model: Fitted, cells: NDArray[np.int64], moment: float, kept: KeptEvidence) -> KeptEvidence:
    """What is kept, held no longer than until sensors said that they are unavailable."""
    if not model.location.hold_samples:
        return kept
    return replace(kept, until=held_until(ctx, model.location, moment, cells, kept.evidence.sample))


def _likelihood(model: Fitted, cells: NDArray[np.int64], readings: Readings) -> NDArray[np.float32]:
    """(n,) the model's probability of each reading when it was read; 1 where there is none."""
    runs, likely = readings.runs, np.ones(len(cells), np.float32)
    order = np.argsort(runs.sample, kind="stable")
    order = order[readings.known[order]]
    sample = runs.sample[order]
    for rows in np.split(order, np.flatnonzero(np.diff(sample)) + 1) if order.size else ():
        time = float(model.location.base.time(runs.sample[rows[0]]))
        p = model.predict(time, cells[rows])
        likely[rows] = np.where(runs.state[rows] == OCCUPIED, p, 1 - p)
    return likely


@dataclass(frozen=True, slots=True)
class _Version:
    """Evidence is out of date where one of these has changed; where only `observations` has, in some cells."""

    revision: int
    observations: int
    first_time: float | None
    deleted: int
    sensor: SensorSetting | None
    hold_samples: int | None


def kept_evidence(ctx: Context, model: Fitted, cells: NDArray[np.int64]) -> KeptEvidence | None:
    """What is kept of the latest readings of these cells; None where it is neither kept nor worth being kept.

    Nothing is of a part of a location.
    """
    if model.chunks is not None:
        return None
    location = model.location
    whole = model.loaded.known
    key = (location.id, model.revision.recipe)
    counted = (location.observation_seq, location.first_time, location.deleted)
    version = _Version(model.revision.revision, *counted, location.sensor, location.hold_samples)
    if len(cells) < len(whole):
        held = ctx.caches.evidence.held(key, version)
        rows = np.searchsorted(whole, cells)
        if held is None or not np.array_equal(whole[np.minimum(rows, len(whole) - 1)], cells):
            return None
        return held.rows(rows)
    if cells is not whole and not np.array_equal(whole, cells):
        return None
    return ctx.caches.evidence.get(key, version, lambda: _renewed(ctx, model, cells, version))


def _renewed(ctx: Context, model: Fitted, cells: NDArray[np.int64], version: _Version) -> KeptEvidence:
    """What is kept of an earlier version with what was read since; all of it read anew where that cannot be told."""
    location = model.location
    latest = location.base.epoch if location.last_time is None else location.last_time
    before = ctx.caches.evidence.latest((location.id, model.revision.recipe))
    if before is not None:
        old, kept = cast(_Version, before[0]), before[1]
        same = replace(old, observations=version.observations) == version
        if same and not kept.damaged and old.observations <= version.observations:
            first = _first_since(ctx, location, old.observations)
            if first is not None:
                return _moved(ctx, model, kept, cells, first)
    return _found(ctx, model, cells, latest)


def _moved(
    ctx: Context, model: Fitted, kept: KeptEvidence, cells: NDArray[np.int64], first: NDArray[np.float64]
) -> KeptEvidence:
    """What is kept of some cells, and what was read since; first (n_cells,): its least time, NaN where nothing was."""
    rows = np.flatnonzero(~np.isnan(first[cells]))
    latest = cast(float, model.location.last_time)
    if not isinstance(kept.evidence, Beliefs):
        new = _found(ctx, model, cells[rows], latest)
        evidence = kept.evidence.replaced(rows, cast(Evidence, new.evidence))
        return KeptEvidence(evidence, new.damaged, _replaced(kept, rows, new))
    before = kept.evidence.rows(rows)
    late = np.flatnonzero(model.location.base.sample(first[cells[rows]]) <= before.sample)
    before.put(late, Beliefs.none(len(late), before.detector))
    new = _bounded(ctx, model, cells[rows], latest, beliefs_at(ctx, model, cells[rows], latest, before))
    beliefs = kept.evidence.replaced(rows, cast(Beliefs, new.evidence))
    return KeptEvidence(beliefs, new.damaged, _replaced(kept, rows, new))


def _replaced(kept: KeptEvidence, rows: NDArray[np.int64], new: KeptEvidence) -> NDArray[np.int64] | None:
    """Until when what is kept may be held, that of some rows replaced."""
    if kept.until is None and new.until is None:
        return None
    until = np.full(len(kept.evidence.sample), ALWAYS) if kept.until is None else kept.until.copy()
    until[rows] = ALWAYS if new.until is None else new.until
    return until


def _first_since(ctx: Context, location: LocationRecord, number: int) -> NDArray[np.float64] | None:
    """(n_cells,) the least time of what was read of each cell in observations after one, NaN where nothing was.

    None where some of them are compacted by now.
    """
    with ctx.store.read() as work:
        if work.locations.by_id(location.id).compacted_seq > number:
            return None
        tail = work.observations.tail(replace(location, compacted_seq=number))
    first = np.full(location.n_cells, np.nan)
    for _, part in tail.parts:
        np.fmin.at(first, part.cell, part.time)
    return first

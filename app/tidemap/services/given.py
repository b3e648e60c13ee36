"""Given: the probability of cells, given what was read of them last (DESIGN 2.8)."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tidemap.history.chunks import CHUNK_CELLS
from tidemap.services.context import Context
from tidemap.services.history import read_times
from tidemap.services.kept import found_evidence, kept_evidence
from tidemap.services.spectra import Fitted
from tidemap.spectral.belief import Beliefs
from tidemap.spectral.conditioning import Evidence, Standing
from tidemap.spectral.persistence import differing
from tidemap.spectral.state_columns import Conditioning

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
        kept = found_evidence(ctx, model, cells, moment)
    limit = int(location.base.sample(min(moment, ctx.clock())))
    standing = Standing(location.hold_samples or 0, limit)
    return Known(ctx, model, cells, kept.evidence, kept.damaged, standing, kept.until)

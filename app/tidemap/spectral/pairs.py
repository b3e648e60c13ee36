"""Pairs of readings of a history, which how long states last is learned from (DESIGN 2.8)."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tidemap.history.history import UNOBSERVED, History
from tidemap.history.timebase import TimeBase
from tidemap.spectral.civil import DAY_S
from tidemap.spectral.conditioning import MIN_PROBABILITY
from tidemap.spectral.prediction import predict_times
from tidemap.spectral.spectrum import Spectrum

MAX_PAIRS: Final = 20_000
MAX_DELTA_S: Final = 14 * DAY_S
STEPS: Final = (0.8191725133961645, 0.6710436067037893, 0.5497004779019703)
"""Of the R3 sequence, which fills a cube evenly (Roberts, 2018)."""
CHANGING: Final = 0.5
"""The share of pairs that are looked for where a state changes between them; the others begin in either state."""
PAIRS_OF_RUN: Final = 3
"""Pairs of a cell that say as much as one run of it."""


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """Pairs of readings of the same cell, (n,) each, the second `delta_s` after the first.

    state, age_s and q are of the first: what was read, how long it had lasted, and the model's probability of it. own
    is the model's probability of the same state at the second, and same whether it was read there. cell: of both.

    evidence: what a pair counts for all cells, in readings that say something of their own. independent: what it counts
    where cells are told apart, as the pairs of a cell may be many more than its runs.
    """

    state: NDArray[np.uint8]
    age_s: NDArray[np.float64]
    q: NDArray[np.float64]
    delta_s: NDArray[np.float64]
    own: NDArray[np.float64]
    same: NDArray[np.bool_]
    cell: NDArray[np.int64]
    evidence: NDArray[np.float64]
    independent: NDArray[np.float64]

    def losses(self, lasted: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(n,) the log loss of the second reading of each given the first, and its slope in ln(r / (1 - r)).

        lasted: r / (1 - r), as `conditioning.condition` has it.
        """
        likely = self.q + self.own * lasted
        kept, lost = self.own * (self.q + lasted), self.q * (1 - self.own)
        slope = self.own * lasted / likely - np.where(self.same, lasted / (self.q + lasted), 0)
        return -np.log(np.where(self.same, kept, lost) / likely), slope


@dataclass(frozen=True, slots=True, eq=False)
class CellReadings:
    """What was read of one cell, (n,) each in order of time: sample, state, and the first sample of its run."""

    sample: NDArray[np.int64]
    state: NDArray[np.uint8]
    begin: NDArray[np.int64]

    @classmethod
    def of(cls, history: History, cell: int) -> "CellReadings":
        """All readings of a cell of a history."""
        states = history.cells(np.array([cell])).states()[0]
        seen = np.flatnonzero(states != UNOBSERVED)
        state, sample = states[seen], history.start + seen
        begins = np.diff(state, prepend=UNOBSERVED) != 0
        return cls(sample, state, sample[np.maximum.accumulate(np.where(begins, np.arange(seen.size), 0))])


def pairs_of(history: History, spectrum: Spectrum, base: TimeBase) -> Pairs | None:
    """Pairs of readings of all cells, `MAX_PAIRS` at most; None where there are none.

    They are spread evenly in the logarithm of their distance, up to 14 days. spectrum: fitted to the same cells.
    """
    some = max(1, MAX_PAIRS // max(1, history.n_cells))
    found = [_of_cell(history, cell, spectrum, base, some) for cell in range(history.n_cells)]
    parts = [part for part in found if part is not None]
    if not parts:
        return None
    columns = ([getattr(part, name) for part in parts] for name in Pairs.__slots__)
    return Pairs(*(np.concatenate(column) for column in columns))


def _of_cell(history: History, cell: int, spectrum: Spectrum, base: TimeBase, n_pairs: int) -> Pairs | None:
    """The pairs of one cell; None where there are none."""
    read = CellReadings.of(history, cell)
    if read.sample.size < 2:
        return None
    longest = max(2.0, min(MAX_DELTA_S / base.interval_s, float(read.sample[-1] - read.sample[0])))
    earlier, wanted, weight = _chosen(read, longest, n_pairs)
    later = np.searchsorted(read.sample, read.sample[earlier] + wanted)
    inside = later < read.sample.size
    if not inside.any():
        return None
    earlier, later, weight = earlier[inside], later[inside], weight[inside]
    state, apart = read.state[earlier], read.sample[later] - read.sample[earlier]
    p = predict_times(spectrum, base.time(read.sample[np.r_[later, earlier]]), [cell])[0].astype(np.float64)
    own = np.where(np.tile(state, 2) != 0, p, 1 - p)
    runs = np.unique(read.begin).size
    return Pairs(
        state=state,
        age_s=np.asarray((read.sample[earlier] - read.begin[earlier] + 1) * base.interval_s, np.float64),
        q=np.maximum(own[later.size :], MIN_PROBABILITY),
        delta_s=np.asarray(apart * base.interval_s, np.float64),
        own=np.clip(own[: later.size], MIN_PROBABILITY, 1 - MIN_PROBABILITY),
        same=read.state[later] == state,
        cell=np.full(later.size, cell),
        evidence=weight * _counted(read, later - earlier, weight, longest) / history.n_cells,
        independent=weight * min(1.0, PAIRS_OF_RUN * runs / later.size),
    )


def _counted(
    read: CellReadings, steps: NDArray[np.int64], weight: NDArray[np.float64], longest: float
) -> NDArray[np.float64]:
    """How many pairs of readings count at a distance, to those that were chosen up to twice as far; (n,).

    All where the readings are neighbours; those that are some steps apart overlap, and count less by the root of that.
    """
    chosen = max(1.0, float(weight.sum() * np.log(2) / np.log(longest)))
    return np.asarray(read.sample.size / np.sqrt(steps) / chosen, np.float64)


def _chosen(
    read: CellReadings, longest: float, n_pairs: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Readings, how many samples to look ahead, and as how many each stands for.

    Half of them, as far as there are any, just before a change of state, as that is what tells; the others of either
    state alike. All are weighed by the density of this mixture, so that their sums are those over all readings.
    """
    number = np.arange(1, n_pairs + 1)
    wanted = np.rint(longest ** (number * STEPS[0] % 1)).astype(np.int64)
    position, back = number * STEPS[1] % 1, number * STEPS[2] % 1
    free, occupied = np.flatnonzero(read.state == 0), np.flatnonzero(read.state)
    if not free.size or not occupied.size:
        return (position * read.state.size).astype(np.int64), wanted, np.ones(n_pairs)
    kind = number % 4
    first = np.where(
        kind == 0, free[(position * free.size).astype(int)], occupied[(position * occupied.size).astype(int)]
    )
    change = read.sample[np.flatnonzero(np.diff(read.state)) + 1]
    after = change[(position * change.size).astype(int)]
    before = np.searchsorted(read.sample, after - 1 - (back * wanted).astype(np.int64), side="right") - 1
    found = (before >= 0) & (read.sample[before] + wanted >= after)
    chosen = np.where(kind < 2, first, before)
    chosen, wanted = chosen[(kind < 2) | found], wanted[(kind < 2) | found]
    return chosen, wanted, _stands_for(read, chosen, wanted, change)


def _stands_for(
    read: CellReadings, chosen: NDArray[np.int64], wanted: NDArray[np.int64], change: NDArray[np.int64]
) -> NDArray[np.float64]:
    """The density of a reading among all of them over that among those chosen; change: the first samples of runs."""
    sample, n = read.sample, read.sample.size
    n_occupied = np.count_nonzero(read.state)
    alone = 1 / np.where(read.state[chosen] != 0, n_occupied, n - n_occupied)
    end = sample[chosen] + wanted
    passed = np.searchsorted(change, end, side="right") - np.searchsorted(change, sample[chosen], side="right")
    gap = np.diff(sample, append=sample[-1] + 1)[chosen]
    density = (1 - CHANGING) / 2 * alone + CHANGING * passed * gap / (change.size * wanted)
    return np.asarray(1 / (n * density))

"""Learning how long states last at a location, from pairs of readings of its history (DESIGN 2.8)."""

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit, log_softmax, logsumexp, softmax

from tidemap.history.history import UNOBSERVED, History
from tidemap.history.timebase import TimeBase
from tidemap.spectral.civil import DAY_S
from tidemap.spectral.conditioning import Persistence, condition
from tidemap.spectral.prediction import predict_times
from tidemap.spectral.spectrum import Spectrum

MAX_PAIRS: Final = 20_000
MAX_DELTA_S: Final = 14 * DAY_S
PRIOR_MEAN: Final = np.array([2.0, np.log(1800.0), 0.0, -2.0])
"""Of logit ν, ln τ in seconds, ln α and ln κ."""
PRIOR_SD: Final = np.array([1.5, 2.0, 1.0, 1.5])
STEPS: Final = (0.7548776662466927, 0.5698402909980532)
"""Of the R2 sequence, which fills a square evenly (Roberts, 2018)."""
LEAST_P: Final = 1e-6
OFFSETS: Final = np.arange(-8, 9) / 4
"""By which ln τ of a cell may differ from its location's."""
OFFSET_SDS: Final = (0.01, 0.25, 0.5, 1.0)
"""How far cells may differ, as standard deviations; with the first they are alike."""
PAIRS_OF_RUN: Final = 3
"""Pairs of a cell that say as much as one run of it."""


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """Pairs of readings of the same cell, (n,) each, the second `delta_s` after the first.

    state, age_s and q are of the first: how long it had lasted, and the model's probability of it. p and truth are of
    the second. cell: of both. independent: what a pair counts where cells are told apart, as those of a cell may be
    many more than its runs.
    """

    state: NDArray[np.uint8]
    age_s: NDArray[np.float64]
    q: NDArray[np.float64]
    delta_s: NDArray[np.float64]
    p: NDArray[np.float64]
    truth: NDArray[np.uint8]
    weight: NDArray[np.float64]
    cell: NDArray[np.int64]
    independent: NDArray[np.float64]

    def losses(self, persistence: Persistence) -> NDArray[np.float64]:
        """(n,) the log loss of the second reading of each, given the first, weighed."""
        p = condition(self.p, self.q, self.state, persistence.kept(self.delta_s, self.age_s))
        likely = np.where(self.truth != 0, p, 1 - p)
        return np.asarray(-self.weight * np.log(np.maximum(likely, LEAST_P)), np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class Lasting:
    """How long states last: of all cells, and by how much ln τ differs in each, (n_cells,)."""

    persistence: Persistence
    offset: NDArray[np.float64]


def learn_lasting(history: History, spectrum: Spectrum, base: TimeBase) -> Lasting:
    """`learn_persistence`, and of every cell the expected offset of ln τ (empirical Bayes): the more the cells differ
    and the more pairs one has, the more of its own it keeps. A single one has nothing to differ from.
    """
    pairs = pairs_of(history, spectrum, base)
    shared = _shared(pairs)
    if history.n_cells < 2:
        return Lasting(shared, np.zeros(history.n_cells))
    fits = np.empty((history.n_cells, len(OFFSETS)))
    for column, offset in enumerate(OFFSETS.tolist()):
        losses = pairs.losses(differing(shared, offset)) * pairs.independent
        fits[:, column] = -np.bincount(pairs.cell, losses, history.n_cells)
    return Lasting(shared, _expected(fits))


def _expected(fits: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n_cells,) the mean of the offset of each cell, given the log likelihood (n_cells, len(OFFSETS)) of every one.

    Their standard deviation is the one of `OFFSET_SDS` under which the cells together are most probable.
    """
    priors = [log_softmax(-np.square(OFFSETS / sd) / 2) for sd in OFFSET_SDS]
    best = max(priors, key=lambda prior: float(logsumexp(fits + prior, axis=1).sum()))
    return np.asarray(softmax(fits + best, axis=1) @ OFFSETS, np.float64)


def differing(persistence: Persistence, offset: float) -> Persistence:
    """That of a cell whose ln τ differs by `offset`."""
    return replace(persistence, tau_s=persistence.tau_s * float(np.exp(offset)))


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


def learn_persistence(history: History, spectrum: Spectrum, base: TimeBase) -> Persistence:
    """The mode of the log loss of pairs of readings under a normal prior, shared by the cells of a history.

    spectrum: fitted to the same cells. Pairs are spread evenly in the logarithm of their distance, up to 14 days. With
    nothing to learn from it is the mean of the prior.
    """
    return _shared(pairs_of(history, spectrum, base))


def _shared(pairs: Pairs) -> Persistence:
    if not pairs.state.size:
        return _persistence(PRIOR_MEAN)

    def cost(theta: NDArray[np.float64]) -> float:
        off = np.square((theta - PRIOR_MEAN) / PRIOR_SD).sum() / 2
        return float(off + pairs.losses(_persistence(theta)).sum())

    bounds = [(mean - 4 * sd, mean + 4 * sd) for mean, sd in zip(PRIOR_MEAN, PRIOR_SD, strict=True)]
    return _persistence(minimize(cost, PRIOR_MEAN, method="L-BFGS-B", bounds=bounds).x)


def _persistence(theta: NDArray[np.float64]) -> Persistence:
    return Persistence(float(expit(theta[0])), *np.exp(theta[1:]).tolist())


def pairs_of(history: History, spectrum: Spectrum, base: TimeBase) -> Pairs:
    """Pairs of readings of all cells, `MAX_PAIRS` at most."""
    some = max(1, MAX_PAIRS // max(1, history.n_cells))
    found = [_of_cell(history, cell, spectrum, base, some) for cell in range(history.n_cells)]
    columns = zip(*(part for part in found if part is not None), strict=True)
    joined = [np.concatenate(column) for column in columns]
    return Pairs(*joined) if joined else Pairs(*(np.empty(0, np.int64) for _ in range(9)))  # type: ignore[arg-type]


def _of_cell(
    history: History, cell: int, spectrum: Spectrum, base: TimeBase, n_pairs: int
) -> tuple[NDArray[Any], ...] | None:
    """The columns of the pairs of one cell; None where it was read once at most."""
    readings = CellReadings.of(history, cell)
    state, seen, begin = readings.state, readings.sample - history.start, readings.begin - history.start
    if seen.size < 2:
        return None
    earlier, wanted, weight = _chosen(state, seen, base.interval_s, n_pairs)
    later = np.searchsorted(seen, seen[earlier] + wanted)
    inside = later < seen.size
    earlier, later, weight = earlier[inside], later[inside], weight[inside]
    p = predict_times(spectrum, base.time(history.start + seen[np.r_[later, earlier]]), [cell])[0].astype(np.float64)
    at_first = p[later.size :]
    q = np.where(state[earlier] != 0, at_first, 1 - at_first)
    age_s = (seen[earlier] - begin[earlier] + 1) * base.interval_s
    delta_s = (seen[later] - seen[earlier]) * base.interval_s
    of_cell = np.full(later.size, cell)
    independent = np.full(later.size, min(1.0, PAIRS_OF_RUN * np.unique(begin).size / max(1, later.size)))
    return state[earlier], age_s, q, delta_s, p[: later.size], state[later], weight, of_cell, independent


def _chosen(
    state: NDArray[np.uint8], seen: NDArray[np.int64], interval_s: float, n_pairs: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Readings, half of them of each state, how many samples to look ahead, and what each of them counts."""
    number = np.arange(1, n_pairs + 1)
    longest = max(2.0, min(MAX_DELTA_S / interval_s, float(seen[-1] - seen[0])))
    wanted = np.rint(longest ** (number * STEPS[0] % 1)).astype(np.int64)
    position = number * STEPS[1] % 1
    free, occupied = np.flatnonzero(state == 0), np.flatnonzero(state)
    if not free.size or not occupied.size:
        return (position * seen.size).astype(np.int64), wanted, np.ones(n_pairs)
    first = number % 2 == 0
    chosen = np.where(first, free[(position * free.size).astype(int)], occupied[(position * occupied.size).astype(int)])
    weight = 2 * np.where(first, free.size, occupied.size) / seen.size
    return chosen, wanted, weight

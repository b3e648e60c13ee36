"""Learning how long states last at a location, from pairs of readings of its history (DESIGN 2.8)."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.sparse import csr_array
from scipy.special import expit, log_softmax, logsumexp, softmax

from tidemap.history.history import History
from tidemap.history.timebase import TimeBase
from tidemap.spectral.conditioning import MAX_LASTED, UNLEARNED, Persistence
from tidemap.spectral.correction import AGE_STEP, DELTA_STEP, LastingCorrection
from tidemap.spectral.pairs import Pairs, pairs_of
from tidemap.spectral.spectrum import Spectrum

PRIOR_MEAN: Final = np.array([2.0, np.log(1800.0), 0.0, -2.0])
"""Of logit ν, ln τ in seconds, ln α and ln κ."""
PRIOR_SD: Final = np.array([1.5, 2.0, 1.0, 1.5])
CORRECTION_SD: Final = 2.0
"""Of every entry of the correction, under its prior."""
STEP_SD: Final = 0.5
"""Of the difference of neighbouring entries."""
MAX_ENTRIES: Final = (24, 10)
"""Of the correction: distances and ages."""
MAX_STEPS: Final = 100
DIGITS: Final = 3
"""Of the correction, as it is stored."""
OFFSETS: Final = np.arange(-8, 9) / 4
"""By which ln (τ + κ a) of a cell may differ from its location's."""
OFFSET_SDS: Final = (0.01, 0.25, 0.5, 1.0)
"""How far cells may differ, as standard deviations; with the first they are alike."""

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Lasting:
    """How long states last: of all cells, and by how much ln (τ + κ a) differs in each, (n_cells,)."""

    persistence: Persistence
    offset: NDArray[np.float64]


def learn_lasting(history: History, spectrum: Spectrum, base: TimeBase) -> Lasting:
    """`learn_persistence`, and of every cell the expected offset of ln (τ + κ a) (empirical Bayes).

    The more the cells differ and the more pairs one has, the more of its own it keeps. A single one has nothing to
    differ from.
    """
    pairs = pairs_of(history, spectrum, base)
    if pairs is None:
        return Lasting(UNLEARNED, np.zeros(history.n_cells))
    shared = _shared(pairs, base.interval_s)
    if history.n_cells < 2:
        return Lasting(shared, np.zeros(history.n_cells))
    fits = np.empty((history.n_cells, len(OFFSETS)))
    for column, offset in enumerate(OFFSETS.tolist()):
        losses = pairs.losses(_lasted(differing(shared, offset), pairs))[0] * pairs.independent
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
    """That of a cell whose states last longer by the factor exp(`offset`): its ln (τ + κ a) differs by that."""
    factor = float(np.exp(offset))
    return replace(persistence, tau_s=persistence.tau_s * factor, kappa=persistence.kappa * factor)


def learn_persistence(history: History, spectrum: Spectrum, base: TimeBase) -> Persistence:
    """The mode of the log loss of pairs of readings under normal priors, shared by the cells of a history.

    First of the formula, then of what it leaves to be corrected. spectrum: fitted to the same cells. With nothing to
    learn from it is the mean of the prior.
    """
    pairs = pairs_of(history, spectrum, base)
    return UNLEARNED if pairs is None else _shared(pairs, base.interval_s)


def _shared(pairs: Pairs, interval_s: float) -> Persistence:
    formula = _formula(pairs)
    return replace(formula, correction=_correction(pairs, formula, interval_s))


def _lasted(persistence: Persistence, pairs: Pairs) -> Vector:
    r = persistence.kept(pairs.state, pairs.delta_s, pairs.age_s)
    return np.asarray(r / (1 - r))


def _formula(pairs: Pairs) -> Persistence:
    """ν, τ, α and κ."""

    def cost(theta: Vector) -> tuple[float, Vector]:
        nu, tau_s, alpha, lived_s = expit(theta[0]), np.exp(theta[1]), np.exp(theta[2]), np.exp(theta[3]) * pairs.age_s
        span = tau_s + lived_s
        log_left = np.log(span / (span + pairs.delta_s))
        r = nu * np.exp(alpha * log_left)
        loss, slope = pairs.losses(r / (1 - r))
        by_span = alpha * (1 / span - 1 / (span + pairs.delta_s))
        by_theta = np.stack((np.full_like(r, 1 - nu), tau_s * by_span, alpha * log_left, lived_s * by_span))
        return float((pairs.evidence * loss).sum()), by_theta @ (pairs.evidence * slope / (1 - r))

    theta = _mode(cost, PRIOR_MEAN, np.diag(PRIOR_SD**-2.0), 4 * PRIOR_SD)
    return Persistence(float(expit(theta[0])), *np.exp(theta[1:]).tolist())


def _correction(pairs: Pairs, formula: Persistence, interval_s: float) -> LastingCorrection:
    """What the formula leaves, to `DIGITS`: a table, smooth under its prior."""
    n_deltas, n_ages = (
        int(np.clip(np.ceil(np.log(pairs.delta_s.max() / interval_s) / np.log(step)) + 1, 2, most))
        for step, most in zip((DELTA_STEP, AGE_STEP), MAX_ENTRIES, strict=True)
    )
    table = LastingCorrection(interval_s, np.zeros((2, n_deltas, n_ages)))
    entries, before = _entries(table, pairs), _lasted(formula, pairs)

    def cost(value: Vector) -> tuple[float, Vector]:
        lasted = before * np.exp(entries @ value)
        loss, slope = pairs.losses(np.minimum(MAX_LASTED, lasted))
        gradient = entries.T @ (pairs.evidence * np.where(lasted < MAX_LASTED, slope, 0))
        return float((pairs.evidence * loss).sum()), gradient

    value = _mode(cost, table.value.ravel(), _smoothness(n_deltas, n_ages))
    return replace(table, value=value.reshape(table.value.shape).round(DIGITS))


def _entries(table: LastingCorrection, pairs: Pairs) -> csr_array:
    """(n_pairs, n_entries): the entries that each pair lies between."""
    _, n_deltas, n_ages = table.value.shape
    corners = table.corners(pairs.delta_s, pairs.age_s)
    column = [(pairs.state.astype(np.int64) * n_deltas + i) * n_ages + j for i, j, _ in corners]
    row = np.tile(np.arange(pairs.state.size), len(corners))
    part = np.concatenate([share for _, _, share in corners])
    return csr_array((part, (row, np.concatenate(column))), (pairs.state.size, table.value.size))


def _smoothness(n_deltas: int, n_ages: int) -> NDArray[np.float64]:
    """The precision of the prior of the correction."""
    rough = [np.diff(np.eye(n), axis=0) for n in (n_deltas, n_ages)]
    over_delta, over_age = (each.T @ each for each in rough)
    one = np.kron(over_delta, np.eye(n_ages)) + np.kron(np.eye(n_deltas), over_age)
    return np.asarray(np.kron(np.eye(2), one / STEP_SD**2 + np.eye(n_deltas * n_ages) / CORRECTION_SD**2), np.float64)


def _mode(
    cost: Callable[[Vector], tuple[float, Vector]],
    mean: Vector,
    precision: NDArray[np.float64],
    furthest: Vector | float = np.inf,
) -> Vector:
    """Where a log loss under a normal prior is least, at most so far from its mean; the cost has its gradient, too."""

    def total(theta: Vector) -> tuple[float, Vector]:
        loss, gradient = cost(theta)
        pull = precision @ (theta - mean)
        return loss + float((theta - mean) @ pull) / 2, gradient + pull

    bounds = list(zip(mean - furthest, mean + furthest, strict=True))
    found = minimize(total, mean, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": MAX_STEPS})
    return np.asarray(found.x, np.float64)

"""The `calendar` estimator: p(t) on the logit scale as waves of the civil day and week."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tidemap.history.history import History
from tidemap.history.timebase import TimeBase
from tidemap.spectral.calendar import folding, level, waves
from tidemap.spectral.calendar.folding import Visits
from tidemap.spectral.calendar.logistic import evaluate, fit_rows
from tidemap.spectral.recipe import Prior, Recipe
from tidemap.spectral.spacing import DENSE, spacing
from tidemap.spectral.spectrum import Spectrum, compact, static
from tidemap.spectral.static import HALF_VISIT

BLOCK = 64
FEW_PRIORS = 4
REFIT_BELOW = 16
"""With fewer waves than this the kept ones are fitted again without the others."""


def fit_calendar(history: History, recipe: Recipe, base: TimeBase) -> Spectrum:
    """The average, on the logit scale, of the most probable rhythms under every prior of the recipe.

    Of each cell the `order` waves of greatest magnitude are kept. Cells whose observed samples agree
    have a mean alone; half a visit of each state is added to it, so that no probability is 0 or 1.
    Only the latest `folding.MAX_DAYS` are read. Cost per varying cell: one count of the history's
    visits to slots and some ten matrix products of 672 × 145 per prior.
    """
    history = folding.recent(history, base)
    n_observed, n_occupied = history.count_observed(), history.count_occupied()
    visits = folding.visits(history, base, recipe.time_zone, recipe.calendar).phased(recipe.period_s)
    mean = _means(history, n_observed, n_occupied, visits, base)
    plain = replace(static(mean, base, link="logit"), time_zone=recipe.time_zone, calendar=recipe.calendar)
    varying = np.flatnonzero((n_occupied > 0) & (n_occupied < n_observed))
    if not varying.size:
        return plain
    frequency_hz, gate = waves.table(recipe.period_s)
    order = min(recipe.order, frequency_hz.size)
    index = np.zeros((varying.size, order), np.uint16)
    coefficient = np.zeros((varying.size, order), np.complex64)
    for first in range(0, varying.size, BLOCK):
        rows = varying[first : first + BLOCK]
        beta = fit_cells(history, rows, visits, recipe, base)
        mean[rows] = beta[:, 0]
        part = slice(first, first + rows.size)
        index[part], coefficient[part] = top_k(beta, order)
    if not order:
        return plain
    return compact(
        replace(
            plain,
            frequency_hz=frequency_hz,
            gate=gate,
            cell=varying.astype(np.int32),
            index=index,
            coefficient=coefficient,
        )
    )


def fit_cells(
    history: History, rows: NDArray[np.int64], visits: Visits, recipe: Recipe, base: TimeBase
) -> NDArray[np.float32]:
    """Coefficients (n_rows, 1 + 2 N_WAVES) of some cells: of each at most `order` waves are not 0."""
    lives = sorted({prior.half_life_days for prior in recipe.priors})
    every = np.ones((len(lives), visits.n_days), np.float32)
    weeks = folding.fold(history, rows, visits, every, lives)
    by_life = {life: (weeks.n_observed[i], weeks.n_occupied[i]) for i, life in enumerate(lives)}
    design = waves.design(folding.slot_offset_s(base), visits.phase is not None)
    resolved = resolved_columns(history, rows, base, recipe.period_s)
    beta = blend_fits(design, by_life, recipe.priors, resolved)
    if recipe.order < waves.N_WAVES:
        kept = kept_columns(beta, recipe.order) if resolved is None else kept_columns(beta, recipe.order) * resolved
        beta = blend_fits(design, by_life, recipe.priors, kept) if recipe.order < REFIT_BELOW else beta * kept
    if recipe.carry_over:
        latest = folding.fold(history, rows, visits, level.latest_days(visits.date, visits.today)[np.newaxis])
        apart = level.departures(evaluate(design, beta), latest.n_observed[0], latest.n_occupied[0])
        beta[:, 0] += recipe.carry_over * apart
    return beta * level.caution(recipe.level_sd, folding.days_seen(history, rows, visits))[:, np.newaxis]


def resolved_columns(
    history: History, rows: NDArray[np.int64], base: TimeBase, period_s: float | None
) -> NDArray[np.float32] | None:
    """1 for the intercept and the columns of the waves that the spacing of each cell's observations tells, else 0.

    (n_rows, n_columns); None where all are resolved.
    """
    apart_s = spacing(history, rows) * base.interval_s
    frequency_hz, _ = waves.table(period_s)
    resolved = (2 * frequency_hz * apart_s[:, np.newaxis] < 1) | (apart_s[:, np.newaxis] <= base.interval_s)
    if resolved.all():
        return None
    return np.concatenate((np.ones((rows.size, 1)), resolved, resolved), axis=1).astype(np.float32)


def blend_fits(
    design: NDArray[np.float32],
    by_life: dict[float, tuple[NDArray[np.float32], NDArray[np.float32]]],
    priors: tuple[Prior, ...],
    kept: NDArray[np.float32] | None,
) -> NDArray[np.float32]:
    """The average of the fits under every prior, of the kept columns only.

    Priors of a kind are fitted together, and each kind begins where the average of those before it is.
    """
    n_cells = next(iter(by_life.values()))[0].shape[0]
    total, whole, start = np.zeros((n_cells, design.shape[1]), np.float32), 0.0, None
    for alike in kinds(priors):
        n_observed, n_occupied = (
            np.concatenate([by_life[priors[i].half_life_days][side] for i in alike]) for side in (0, 1)
        )
        evidence = np.repeat([np.float32(priors[i].evidence) for i in alike], n_cells)
        penalty = waves.penalties(priors[alike[0]], design.shape[0] > waves.SLOTS)
        allowed, begin = (None if each is None else np.tile(each, (len(alike), 1)) for each in (kept, start))
        found = fit_rows(design, n_observed, n_occupied, evidence, penalty, allowed, begin).reshape(
            len(alike), n_cells, -1
        )
        for i, beta in zip(alike, found, strict=True):
            total += np.float32(priors[i].weight) * beta
            whole += priors[i].weight
        start = total / np.float32(whole)
    return total / np.float32(whole)


def kinds(priors: Sequence[Prior]) -> list[list[int]]:
    """The places of the priors that have the same penalties: they differ in evidence, half-life and weight alone.

    Of FEW_PRIORS each is a kind of its own, for a fit that begins where a similar one ended is soon done.
    """
    if len(priors) <= FEW_PRIORS:
        return [[i] for i in range(len(priors))]
    found: dict[tuple[str, str], list[int]] = {}
    for i, prior in enumerate(priors):
        found.setdefault((prior.week, prior.detail), []).append(i)
    return list(found.values())


def _means(
    history: History, n_observed: NDArray[np.int64], n_occupied: NDArray[np.int64], visits: Visits, base: TimeBase
) -> NDArray[np.float32]:
    """The logit of the share of occupied samples, in visits to slots, half a visit of each kind added.

    0 of cells that change, whose mean is fitted.
    """
    mean = np.where(n_observed > 0, np.float32(0), np.float32(np.nan))
    alike = np.flatnonzero((n_observed > 0) & ((n_occupied == 0) | (n_occupied == n_observed)))
    n_visits = n_observed[alike] / max(1.0, waves.SLOT_S / base.interval_s)
    sparse = np.flatnonzero(n_observed[alike] < DENSE * history.n_samples)
    n_visits[sparse] = folding.visits_seen(history, alike[sparse], visits)
    side = np.where(n_occupied[alike] > 0, 1, -1)
    mean[alike] = side * np.log((n_visits + HALF_VISIT) / HALF_VISIT)
    return mean


def _magnitude(beta: NDArray[np.float32]) -> NDArray[np.float32]:
    cosine, sine = np.split(beta[:, 1:], 2, axis=1)
    return np.asarray(cosine * cosine + sine * sine)


def kept_columns(beta: NDArray[np.float32], order: int) -> NDArray[np.float32]:
    """1 for the intercept and the columns of the `order` greatest waves of every cell, else 0."""
    rank = np.argsort(np.argsort(-_magnitude(beta), axis=1, kind="stable"), axis=1)
    chosen = (rank < order).astype(np.float32)
    return np.concatenate((np.ones((beta.shape[0], 1), np.float32), chosen, chosen), axis=1)


def top_k(beta: NDArray[np.float32], order: int) -> tuple[NDArray[np.int64], NDArray[np.complex64]]:
    """Index and coefficient (n_cells, order) of the greatest waves, descending.

    A wave a cos φ + b sin φ is 2 Re c exp(iφ) with c = (a - ib) / 2.
    """
    index = np.argsort(-_magnitude(beta), axis=1, kind="stable")[:, :order]
    cosine, sine = (np.take_along_axis(each, index, axis=1) for each in np.split(beta[:, 1:], 2, axis=1))
    coefficient = (cosine - 1j * sine).astype(np.complex64) / np.complex64(2)
    return np.where(coefficient == 0, 0, index), coefficient

"""Blending: which priors of `calendar` to average, by how well each predicted and what is believed beforehand.

No single setting wins by more than chance on a short history, and the average of the good ones is better
than the best of them. The weight of a setting is belief · exp(-TRUST · log loss): a posterior whose
likelihood is tempered, as neighbouring visits are far from independent.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tidemap.spectral.auto.trials import SHORT_DAYS, Task, losses
from tidemap.spectral.calendar import folding, level, waves
from tidemap.spectral.calendar.estimator import fit_calendar, kept_columns, kinds, resolved_columns
from tidemap.spectral.calendar.folding import Weeks
from tidemap.spectral.calendar.logistic import evaluate, fit_rows
from tidemap.spectral.calendar.periods import find_period
from tidemap.spectral.recipe import Detail, Prior, Recipe, Week

TRUST = 0.04
"""What a nat of log loss counts where neighbouring visits are a quarter of an hour apart or less."""
TRUST_SHORT = 0.025
"""Days left out of one week are more like their neighbours than days to come will be."""
FEW_CELLS = 4
MEMBERS = (60, 2)
"""Priors averaged at most: where few cells decide, all of some weight, and where many do and cost counts."""
DEAR_EVIDENCE = 1.0
"""More evidence, sharp edges and weekdays that differ much take more steps to fit: for few cells only."""
MIN_WEIGHT = 0.002
PERIOD_BELIEF = 2.0
"""What a period has to be better by, as a logarithm, for it was found on the days it is tried on."""
MARGINS = (1.0, 1.002)
"""A higher order has to lower the log loss by this factor: of few cells it costs nothing."""

WEEKS: dict[Week, float] = {"day": 0.0, "weekend": 0.0, "week": 0.5, "days": 0.0}
DETAILS: tuple[Detail, ...] = ("smooth", "sharp")
SHARP_EVIDENCE: dict[Week, tuple[float, float]] = {
    "day": (0.25, 4.0),
    "weekend": (0.25, 4.0),
    "week": (1.0, 16.0),
    "days": (1.0, 16.0),
}
"""Least and most evidence under which sharp edges are tried; those of single weekdays are seen with much only."""
SEEN_ONCE: tuple[tuple[Week, Detail], ...] = (
    ("day", "smooth"),
    ("day", "sharp"),
    ("weekend", "smooth"),
    ("week", "smooth"),
)
"""What is tried where no weekday comes twice: what sets single days apart is then hardly known from chance."""
EVIDENCE = (16.0, 4.0, 1.0, 0.25, 0.0625)
EVIDENCE_SLOPE = (-0.14, 0.33)
"""Belief in more evidence, for every factor e: where visits are close, and what is added for every factor e of
their distance."""
HALF_LIVES = (math.inf, 7.0)
SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Shares of the last day's departure that may be followed."""
SHARE_SLOPE = -2.0
"""Belief in following all of it against none, beforehand: that days depend on each other has to show."""
CARRY_OVER_TRUST = 8.0
"""How much more than `trust` a nat counts in that: one number is chosen, not a whole rhythm."""
LEVEL_SD = 0.4
"""Standard deviation of the level of a week, on the logit scale."""


def grid(interval_s: float, n_cells: int, n_days: int) -> tuple[list[Prior], NDArray[np.float64]]:
    """The priors tried and the logarithms of what is believed of each."""
    slope = EVIDENCE_SLOPE[0] + EVIDENCE_SLOPE[1] * math.log(_spacing(interval_s))
    tried = [
        (week, detail, evidence)
        for week in WEEKS
        for detail in DETAILS
        for evidence in EVIDENCE
        if (detail == "smooth" or SHARP_EVIDENCE[week][0] <= evidence <= SHARP_EVIDENCE[week][1])
        and (n_days >= SHORT_DAYS or (week, detail) in SEEN_ONCE)
    ]
    if n_cells > FEW_CELLS:
        tried = [each for each in tried if each[0] != "days" and each[1] == "smooth" and each[2] <= DEAR_EVIDENCE]
    belief = {
        Prior(week, detail, evidence, life): WEEKS[week] + slope * math.log(evidence)
        for week, detail, evidence in tried
        for life in HALF_LIVES
    }
    return list(belief), np.array(list(belief.values()))


def _spacing(interval_s: float) -> float:
    """How far visits are apart, in slots."""
    return max(1.0, interval_s / waves.SLOT_S)


@dataclass(frozen=True, slots=True, eq=False)
class Blend:
    """The priors averaged, how many were tried, and the coefficients (n_trials, n_cells, n_columns) of the average."""

    priors: tuple[Prior, ...]
    tried: int
    beta: NDArray[np.float32]
    design: NDArray[np.float32]
    truth: Weeks
    period_s: float | None = None
    carry_over: float = 0.0
    level_sd: float = 0.0

    @property
    def loss(self) -> float:
        """The log loss of the average of all waves, summed over trials, cells and slots."""
        return float(losses(_logistic(evaluate(self.design, self.beta)), self.truth).sum())

    def probability(self, order: int) -> NDArray[np.float32]:
        """What the average of this order predicted, shaped as the truth."""
        flat = self.beta.reshape(-1, self.beta.shape[-1])
        cut = flat * kept_columns(flat, order) if 1 + 2 * order < flat.shape[1] else flat
        return _logistic(evaluate(self.design, cut.reshape(self.beta.shape)))


def blend(task: Task) -> Blend:
    """Every prior of the grid fitted to every trial, and the best of them averaged."""
    design = waves.design(folding.slot_offset_s(task.base))
    priors, belief = grid(task.base.interval_s, task.history.n_cells, task.visits.n_days)
    beta = _fits(task, priors, design)
    loss = np.array([losses(_logistic(evaluate(design, each)), task.truth).sum() for each in beta])
    chosen, weight = _weights(trust(task) * loss, belief, task.history.n_cells)
    members = tuple(replace(priors[i], weight=float(w)) for i, w in zip(chosen, weight, strict=True))
    average = np.einsum("p,ptcx->tcx", weight.astype(np.float32), beta[chosen])
    return _with_period(task, _levelled(task, Blend(members, len(priors), average, design, task.truth)))


def _with_period(task: Task, mixed: Blend) -> Blend:
    """The same with a period that is no part of the week, where there is one that predicts better."""
    recipe = Recipe("calendar", waves.N_WAVES, task.time_zone, mixed.priors, calendar=task.calendar)
    period_s = find_period(task.history, fit_calendar(task.history, recipe, task.base), task.base)
    if period_s is None:
        return mixed
    split, design = task.phased(period_s), waves.design(folding.slot_offset_s(task.base), True)
    weight = np.array([prior.weight for prior in mixed.priors], np.float32)
    average = np.einsum("p,ptcx->tcx", weight, _fits(split, mixed.priors, design))
    other = _levelled(split, replace(mixed, beta=average, design=design, truth=split.truth, period_s=period_s))
    return other if trust(task) * (mixed.loss - other.loss) > PERIOD_BELIEF else mixed


def _levelled(task: Task, mixed: Blend) -> Blend:
    """The same with the share of the last day's departure that predicted well, and with `LEVEL_SD`."""
    beta, latest = mixed.beta.copy(), _latest(task)
    rows = evaluate(mixed.design, beta).reshape(-1, mixed.design.shape[0])
    n_observed, n_occupied = (each.reshape(rows.shape) for each in (latest.n_observed, latest.n_occupied))
    apart = level.departures(rows, n_observed, n_occupied).reshape(*beta.shape[:2], 1)
    eta = rows.reshape(task.truth.n_observed.shape)
    carry_over = _share([losses(_logistic(eta + share * apart), task.truth).sum() for share in SHARES], task)
    beta[..., :1] += carry_over * apart
    days = np.array([[[trial.learned(task.visits.n_days).sum()]] for trial in task.trials])
    return replace(mixed, beta=beta * level.caution(LEVEL_SD, days), carry_over=carry_over, level_sd=LEVEL_SD)


def _share(loss: Sequence[float], task: Task) -> float:
    """The average share, weighed as settings are, less what fades within a week where trials are shorter.

    Days left out tell nothing of days to come.
    """
    first = task.trials[0]
    known = np.zeros(len(SHARES)) if first.around else np.array(loss)
    weight = np.exp(SHARE_SLOPE * np.array(SHARES) - CARRY_OVER_TRUST * trust(task) * (known - known.min()))
    fading = 1.0 if first.around else level.outlasting(first.last - first.first)
    return round(fading * float((weight * SHARES).sum() / weight.sum()), 2)


def trust(task: Task) -> float:
    """What a nat of log loss summed over the trials of all cells counts; cells repeat each other too."""
    alone = TRUST_SHORT if task.visits.n_days < SHORT_DAYS else TRUST
    return alone * math.sqrt(_spacing(task.base.interval_s) / task.history.n_cells)


def _weights(
    loss: NDArray[np.float64], belief: NDArray[np.float64], n_cells: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The members, most probable first, and their weights, rounded so that they read well; sum 1."""
    log_weight = belief - loss
    most = MEMBERS[n_cells > FEW_CELLS]
    order = np.argsort(-log_weight, kind="stable")[:most]
    weight = np.exp(log_weight[order] - log_weight[order[0]])
    weight = np.round(weight / weight.sum(), 3)
    kept = weight >= MIN_WEIGHT
    return order[kept], weight[kept] / weight[kept].sum()


def _fits(task: Task, priors: Sequence[Prior], design: NDArray[np.float32]) -> NDArray[np.float32]:
    """(n_priors, n_trials, n_cells, n_columns); rows that differ in data and evidence alone are fitted together."""
    shape = (len(task.trials), task.history.n_cells)
    lives = sorted({prior.half_life_days for prior in priors})
    past = _past(task, lives)
    resolved = resolved_columns(task.history, task.cells, task.base, task.period_s)
    beta = np.empty((len(priors), *shape, design.shape[1]), np.float32)
    for alike in kinds(priors):
        task.check()
        life = [lives.index(priors[i].half_life_days) for i in alike]
        n_observed, n_occupied = (
            each[life].reshape(-1, design.shape[0]) for each in (past.n_observed, past.n_occupied)
        )
        evidence = np.repeat([np.float32(priors[i].evidence) for i in alike], shape[0] * shape[1])
        penalty = waves.penalties(priors[alike[0]], task.visits.phase is not None)
        kept = None if resolved is None else np.tile(resolved, (len(alike) * shape[0], 1))
        found = fit_rows(design, n_observed, n_occupied, evidence, penalty, kept)
        beta[alike] = found.reshape(len(alike), *shape, -1)
    return beta


def _past(task: Task, lives: Sequence[float]) -> Weeks:
    """What each trial learns from under each half-life, (n_lives, n_trials, n_cells, slots)."""
    learned = np.array([trial.learned(task.visits.n_days) for trial in task.trials], np.float32)
    each_life = [life for life in lives for _ in task.trials]
    weeks = folding.fold(task.history, task.cells, task.visits, np.tile(learned, (len(lives), 1)), each_life)
    shape = (len(lives), len(task.trials), task.history.n_cells, -1)
    return Weeks(weeks.n_observed.reshape(shape), weeks.n_occupied.reshape(shape))


def _latest(task: Task) -> Weeks:
    """The last days that each trial learns from, (n_trials, n_cells, slots)."""
    visits = task.visits
    days = [
        level.latest_days(visits.date, visits.today if trial.around else int(visits.date[trial.first]) - 1)
        * trial.learned(visits.n_days)
        for trial in task.trials
    ]
    return folding.fold(task.history, task.cells, visits, np.array(days, np.float32))


def _logistic(eta: NDArray[Any]) -> NDArray[np.float32]:
    return np.asarray(1 / (1 + np.exp(-np.clip(eta, -30, 30))), np.float32)

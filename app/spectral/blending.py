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

from app.spectral import folding, waves
from app.spectral.ascent import fit_rows
from app.spectral.calendar import kept_columns
from app.spectral.folding import Weeks
from app.spectral.recipe import Detail, Prior, Week
from app.spectral.trials import SHORT_DAYS, Task, losses

TRUST = 0.1
FEW_CELLS = 4
MEMBERS = (8, 3)
"""Priors averaged where few cells decide, and where many do and cost counts."""
MARGIN = 1.002
"""A higher order has to lower the log loss by this factor."""

WEEKS: dict[Week, float] = {"day": 0.0, "weekend": 0.0, "week": 0.0, "days": -1.0}
DETAILS: dict[Detail, float] = {"smooth": 0.0, "sharp": -1.0}
EVIDENCE = {4.0: -1.0, 1.0: 0.0, 0.25: 0.0, 0.0625: -0.5, 0.015625: -0.5}
HALF_LIVES = {math.inf: 0.0, 28.0: 0.0, 7.0: -1.5}


def grid(n_days: int) -> tuple[list[Prior], NDArray[np.float64]]:
    """The priors tried and the logarithms of what is believed of each.

    Recency, and weekdays that differ much, only where days of the same name can be compared.
    """
    lives = HALF_LIVES if n_days >= SHORT_DAYS else {math.inf: 0.0}
    belief = {
        Prior(week, detail, evidence, life): WEEKS[week] + DETAILS[detail] + EVIDENCE[evidence] + lives[life]
        for week in WEEKS
        for detail in DETAILS
        for evidence in EVIDENCE
        for life in lives
        if (detail == "smooth" or evidence >= 0.25) and (week != "days" or n_days >= SHORT_DAYS)
    }
    return list(belief), np.array(list(belief.values()))


@dataclass(frozen=True, slots=True, eq=False)
class Blend:
    """The priors averaged, how many were tried, and the coefficients (n_trials, n_cells, n_columns) of the average."""

    priors: tuple[Prior, ...]
    tried: int
    beta: NDArray[np.float32]
    design: NDArray[np.float32]

    def probability(self, order: int) -> NDArray[np.float32]:
        """What the average of this order predicted, (n_trials, n_cells, 672)."""
        flat = self.beta.reshape(-1, self.beta.shape[-1])
        cut = flat * kept_columns(flat, order) if order < waves.N_WAVES else flat
        return _logistic(cut.reshape(self.beta.shape) @ self.design.T)


def blend(task: Task) -> Blend:
    """Every prior of the grid fitted to every trial, and the best of them averaged."""
    design = waves.design(folding.slot_offset_s(task.base))
    priors, belief = grid(task.visits.n_days)
    beta = _fits(task, priors, design)
    loss = np.array([losses(_logistic(each @ design.T), task.truth).sum() for each in beta])
    chosen, weight = _weights(loss / math.sqrt(max(1, task.history.n_cells)), belief, task.history.n_cells)
    members = tuple(replace(priors[i], weight=float(w)) for i, w in zip(chosen, weight, strict=True))
    return Blend(members, len(priors), np.einsum("p,ptcx->tcx", weight.astype(np.float32), beta[chosen]), design)


def _weights(
    loss: NDArray[np.float64], belief: NDArray[np.float64], n_cells: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The members, most probable first, and their weights, rounded so that they read well; sum 1."""
    log_weight = belief - TRUST * (loss - loss.min())
    most = MEMBERS[0] if n_cells <= FEW_CELLS else MEMBERS[1]
    order = np.argsort(-log_weight, kind="stable")[:most]
    weight = np.exp(log_weight[order] - log_weight[order[0]])
    weight = np.round(weight / weight.sum(), 3)
    kept = weight > 0
    return order[kept], weight[kept] / weight[kept].sum()


def _fits(task: Task, priors: Sequence[Prior], design: NDArray[np.float32]) -> NDArray[np.float32]:
    """(n_priors, n_trials, n_cells, n_columns); rows that differ in data and evidence alone are fitted together."""
    shape = (len(task.trials), task.history.n_cells)
    lives = sorted({prior.half_life_days for prior in priors})
    past = _past(task, lives)
    beta = np.empty((len(priors), *shape, design.shape[1]), np.float32)
    for week, detail in dict.fromkeys((prior.week, prior.detail) for prior in priors):
        alike = [i for i, prior in enumerate(priors) if (prior.week, prior.detail) == (week, detail)]
        life = [lives.index(priors[i].half_life_days) for i in alike]
        seen, full = (each[life].reshape(-1, waves.SLOTS) for each in (past.seen, past.full))
        evidence = np.repeat([np.float32(priors[i].evidence) for i in alike], shape[0] * shape[1])
        penalty, used = waves.penalties(priors[alike[0]])
        found = fit_rows(design, seen, full, evidence, penalty[np.newaxis], used[np.newaxis])
        beta[alike] = found.reshape(len(alike), *shape, -1)
    return beta


def _past(task: Task, lives: Sequence[float]) -> Weeks:
    """What each trial learns from under each half-life, (n_lives, n_trials, n_cells, 672)."""
    n_days = task.visits.n_days
    weight = [
        trial.learned(n_days) * folding.recency(n_days if trial.around else trial.first, life, n_days)
        for life in lives
        for trial in task.trials
    ]
    weeks = folding.fold(task.history, task.cells, task.visits, np.array(weight, np.float32))
    shape = (len(lives), len(task.trials), task.history.n_cells, waves.SLOTS)
    return Weeks(weeks.seen.reshape(shape), weeks.full.reshape(shape))


def _logistic(eta: NDArray[Any]) -> NDArray[np.float32]:
    return np.asarray(1 / (1 + np.exp(-np.clip(eta, -30, 30))), np.float32)

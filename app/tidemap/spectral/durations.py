"""Durations: how long each state lasts, learned from the runs that are believed of some cells (DESIGN 2.8)."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from tidemap.history.jit import kernel
from tidemap.spectral.civil import DAY_S
from tidemap.spectral.conditioning import UNLEARNED

RATIO: Final = 1.025
"""Of an age to the one before it in the table."""
MAX_AGE_S: Final = 14 * DAY_S
MIN_AGES: Final = 170
WIDTH: Final = 0.05
"""The standard deviation, of the logarithm, by which a duration that was seen is blurred."""
PRIOR_RUNS: Final = 1.0
"""How many runs the prior is worth."""


@dataclass(frozen=True, slots=True, eq=False)
class BelievedRuns:
    """BelievedRuns of equal states, (n,) each.

    state: uint8. length: in samples. ended: whether their begin and their end were seen. redrawn: the probability that
    a state which is drawn anew is another one, so that the run ends.
    """

    state: NDArray[np.uint8]
    length: NDArray[np.float64]
    ended: NDArray[np.bool_]
    redrawn: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Durations:
    """How long nothing is drawn anew, by the state that stands.

    log_kept: (2, n) float64, of state 0 and 1 the logarithm of the probability that a state is still the same, nothing
    redrawn, at the age of RATIO^i samples. It is a power of the age beyond.
    """

    log_kept: NDArray[np.float64]

    def __post_init__(self) -> None:
        shape = self.log_kept.shape
        if len(shape) != 2 or shape[0] != 2 or shape[1] < 2 or not np.isfinite(self.log_kept).all():
            raise ValueError(f"finite logarithms of two states at two ages or more are needed, not {shape}")

    @classmethod
    def believed(cls, interval_s: float) -> "Durations":
        """What is believed without having learned: τ / (τ + age)."""
        age_s = _ages(interval_s) * interval_s
        return cls(np.tile(-UNLEARNED.alpha * np.log1p(age_s / UNLEARNED.tau_s), (2, 1)))

    @classmethod
    def learned(cls, runs: BelievedRuns, interval_s: float) -> "Durations":
        """By the share of runs at an age that end there, blurred, under a prior that is worth `PRIOR_RUNS`."""
        rows = []
        for state, prior in enumerate(cls.believed(interval_s).log_kept):
            mine = runs.state == state
            some = BelievedRuns(runs.state[mine], runs.length[mine], runs.ended[mine], runs.redrawn[mine])
            rows.append(_log_kept(some, _ages(interval_s), prior))
        return cls(np.array(rows))

    def kept(self, state: int, delta: ArrayLike, age: ArrayLike) -> NDArray[np.float64]:
        """The probability that nothing is redrawn for `delta` samples after a state has lasted `age` samples."""
        before, after = np.asarray(age, np.float64), np.asarray(age, np.float64) + np.asarray(delta, np.float64)
        row = self.log_kept[state]
        log_at = np.vectorize(lambda each: log_kept_at(row, each), otypes=[np.float64])
        return np.asarray(np.exp(log_at(after) - log_at(before)))


def _ages(interval_s: float) -> NDArray[np.float64]:
    """The ages of the table, in samples."""
    n_ages = max(MIN_AGES, int(np.ceil(np.log(MAX_AGE_S / interval_s) / np.log(RATIO))) + 1)
    return np.asarray(RATIO ** np.arange(n_ages), np.float64)


def _log_kept(runs: BelievedRuns, age: NDArray[np.float64], prior: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) of one state: minus the sum of the hazards up to every age, each the ends over the samples at risk."""
    step, log_age = np.diff(age), np.log(age)
    nearest = np.clip(np.rint(np.log(runs.length) / np.log(RATIO)), 0, len(age) - 1).astype(np.int64)
    passed = ndtr((log_age - log_age[:, np.newaxis]) / WIDTH)
    ends = np.bincount(nearest[runs.ended], minlength=len(age)) @ np.diff(passed, axis=1)
    at_risk = np.bincount(nearest, runs.redrawn, len(age)) @ (1 - passed[:, :-1])
    believed = -np.diff(prior)
    hazard = (ends + PRIOR_RUNS * believed) / (at_risk * step + PRIOR_RUNS * step) * step
    return np.asarray(prior[0] - np.concatenate(([0.0], np.cumsum(hazard))), np.float64)


@kernel
def log_kept_at(log_kept: NDArray[np.float64], age: float) -> float:
    """`log_kept` (n,) of one state at an age in samples, linear in the logarithm of the age."""
    at = np.log(max(1.0, age)) / np.log(RATIO)
    first = min(int(at), log_kept.size - 2)
    return float(log_kept[first] + (at - first) * (log_kept[first + 1] - log_kept[first]))

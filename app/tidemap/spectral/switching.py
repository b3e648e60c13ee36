"""Switching: persistence without a rhythm, left at a learned rate; what conditioning is compared with."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize
from scipy.special import expit, logit

MIN_LIKELIHOOD: Final = 1e-9
BOUNDS: Final = ((-14.0, 14.0), (-20.0, 5.0))
"""Of the logit of the mean, and of the logarithm of the rate."""


@dataclass(frozen=True, slots=True)
class Switching:
    """The two-state Markov chain in continuous time: mean is the share occupied, rate how fast a state is forgotten.

    rate: per sample; P(s(t) = 1 | s₀) = mean + (s₀ − mean) · exp(−rate · samples between).
    """

    mean: float
    rate: float

    def expect(self, state: ArrayLike, samples: ArrayLike) -> NDArray[np.float64]:
        """The probability of occupied so many samples after a state was read, of the shape of both together.

        >>> Switching(0.25, 1.0).expect([1, 0, 1], [0, 0, np.inf]).tolist()
        [1.0, 0.0, 0.25]
        """
        first = np.asarray(state) != 0
        return np.asarray(self.mean + (first - self.mean) * np.exp(-self.rate * np.asarray(samples, np.float64)))


def learn_switching(sample: NDArray[np.int64], state: NDArray[np.uint8]) -> Switching:
    """The chain that makes the readings of one cell, in samples (n,) ascending, most likely.

    Half a step of one sample of each kind is counted beside them, so that it knows no certainty.
    """
    before, after, apart, count = _steps(sample, state)

    def cost(theta: NDArray[np.float64]) -> float:
        p = Switching(float(expit(theta[0])), float(np.exp(theta[1]))).expect(before, apart)
        likely = np.where(after != 0, p, 1 - p)
        return -float((count * np.log(np.maximum(likely, MIN_LIKELIHOOD))).sum())

    mean = (np.count_nonzero(state) + 0.5) / (state.size + 1)
    left = count[before != after].sum() / (count * apart).sum()
    least, most = np.array(BOUNDS).T
    start = np.clip(np.array([logit(mean), np.log(left / (2 * mean * (1 - mean)))]), least, most)
    found = minimize(cost, start, method="L-BFGS-B", bounds=BOUNDS).x
    return Switching(float(expit(found[0])), float(np.exp(found[1])))


def _steps(
    sample: NDArray[np.int64], state: NDArray[np.uint8]
) -> tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.int64], NDArray[np.float64]]:
    """From state, to state, samples between and how often, of neighbouring readings and the half steps."""
    kind = 4 * np.diff(sample) + 2 * state[:-1].astype(np.int64) + state[1:]
    step, count = np.unique(np.concatenate((4 + np.arange(4), kind)), return_counts=True)
    apart = step // 4
    before, after = (step // 2 % 2).astype(np.uint8), (step % 2).astype(np.uint8)
    return before, after, apart, np.asarray(count - np.where(apart == 1, 0.5, 0.0), np.float64)

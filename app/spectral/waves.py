"""The waves of `calendar`: harmonics of the civil day and week, and what the prior makes of each."""

from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.spectral.recipe import Detail, Prior, Week
from app.spectral.spectrum import EVERY_DAY, WEEKEND

WEEK_S: Final = 604_800.0
DAY_S: Final = 86_400.0
SLOT_S: Final = 900.0
SLOTS_A_DAY: Final = 96
SLOTS: Final = 672
"""Quarters of an hour in a civil week: what histories are folded into."""

DAY_HARMONICS: Final = 24
WEEKEND_HARMONICS: Final = 8
WEEK_HARMONICS: Final = 12
"""Daily harmonics that differ by weekday, each as its three neighbours on either side, 7k ± 1, 2, 3 cycles a week:
together all that seven days can differ in."""

SCALE: Final = 2.0
"""Standard deviation of the daily rhythm under the prior, on the logit scale."""

INTERCEPT_SD: Final = 6.0

DIFFERENCE: Final[dict[Week, tuple[float, float]]] = {
    "day": (0.0, 0.0),
    "weekend": (0.5, 0.0),
    "week": (0.5, 0.35),
    "days": (0.75, 1.0),
}
"""How much weekends, and single weekdays, may differ, as a share of SCALE."""

DECAY: Final[dict[Detail, tuple[float, float]]] = {"smooth": (2.0, 2.0), "sharp": (8.0, 1.5)}
"""k0 and ν: the variance of harmonic k of the day is proportional to (1 + (k / k0)²)^-ν."""

_DAILY = np.arange(1, DAY_HARMONICS + 1)
_GATED = np.arange(WEEKEND_HARMONICS + 1)
_NEAR = np.repeat(np.arange(WEEK_HARMONICS + 1), 6)
_WEEKLY = 7 * _NEAR + np.tile([-3, -2, -1, 1, 2, 3], WEEK_HARMONICS + 1)
_KEPT = _WEEKLY > 0

CYCLES_A_WEEK: Final = np.concatenate((7 * _DAILY, 7 * _GATED, _WEEKLY[_KEPT]))
HARMONIC: Final = np.concatenate((_DAILY, _GATED, _NEAR[_KEPT]))
"""(N_WAVES,) the harmonic of the day a wave is or, on single weekdays, is near to."""
KIND: Final = np.repeat([0, 1, 2], [_DAILY.size, _GATED.size, int(_KEPT.sum())])
"""(N_WAVES,) 0 every day, 1 weekends only, 2 of single weekdays."""
N_WAVES: Final = int(CYCLES_A_WEEK.size)
FREQUENCY_HZ: Final = CYCLES_A_WEEK / WEEK_S
GATE: Final = np.where(KIND == 1, WEEKEND, EVERY_DAY).astype(np.uint8)


def variances(prior: Prior) -> NDArray[np.float64]:
    """The prior variance of the cosine and of the sine of each wave, (N_WAVES,); 0 where it is left out.

    Those of the day sum to SCALE². Waves at or near harmonic 0 move whole days up or down.
    """
    k0, nu = DECAY[prior.detail]
    decay = (1 + (np.arange(DAY_HARMONICS + 1) / k0) ** 2) ** -nu
    decay /= decay[1:].sum()
    weekend, week = DIFFERENCE[prior.week]
    level = HARMONIC == 0
    share = decay[HARMONIC] * np.where(KIND == 2, 1 / 6, 1)
    share = np.where(level, np.where(KIND == 2, 1 / 3, 1), share)
    return np.asarray(SCALE**2 * np.array([1, weekend**2, week**2])[KIND] * share)


@lru_cache(maxsize=256)
def penalties(prior: Prior) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """The penalty of every column of the design, (1 + 2 N_WAVES,), and 1 where the prior has it, else 0."""
    variance = variances(prior)
    both = np.concatenate(([INTERCEPT_SD**2], variance, variance))
    used = both > 0
    return (1 / np.where(used, both, 1)).astype(np.float32), used.astype(np.float32)


@lru_cache(maxsize=64)
def design(offset_s: float) -> NDArray[np.float32]:
    """(SLOTS, 1 + 2 N_WAVES): a one, then gate · cos and gate · sin of every wave, `offset_s` into every slot."""
    tau_s = np.asarray(SLOT_S * np.arange(SLOTS) + offset_s, np.float64)
    return columns(tau_s).astype(np.float32)


def columns(tau_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same at any civil seconds (n,) since a Monday midnight."""
    angle = 2 * np.pi * ((tau_s[:, np.newaxis] % WEEK_S) * FREQUENCY_HZ)
    passed = (GATE == EVERY_DAY) | ((tau_s // DAY_S % 7) >= 5)[:, np.newaxis]
    return np.concatenate((np.ones((tau_s.size, 1)), np.cos(angle) * passed, np.sin(angle) * passed), axis=1)

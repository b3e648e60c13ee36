"""The waves of `calendar`: harmonics of the civil day and week, and what the prior makes of each."""

from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tidemap.spectral.civil import DAY_S, WEEK_S
from tidemap.spectral.recipe import Detail, Prior, Week
from tidemap.spectral.spectrum import EVERY_DAY, WEEKEND

SLOT_S: Final = 900.0
SLOTS_A_DAY: Final = 96
SLOTS: Final = 672
"""Quarters of an hour in a civil week: what histories are folded into."""

DAY_HARMONICS: Final = 48
WEEKEND_HARMONICS: Final = 8
WEEK_HARMONICS: Final = 12
"""Daily harmonics that differ by weekday, each as its three neighbours on either side, 7k ± 1, 2, 3 cycles a week:
together all that seven days can differ in."""

SCALE: Final = 2.0
"""Standard deviation of the daily rhythm under the prior, on the logit scale."""

INTERCEPT_SD: Final = 6.0
NEGLIGIBLE: Final = 4e-4
"""Waves of less prior variance, which could move p(t) by half a hundredth, are not worth their cost."""

DIFFERENCE: Final[dict[Week, tuple[float, float]]] = {
    "day": (0.0, 0.0),
    "weekend": (0.5, 0.0),
    "week": (0.5, 0.35),
    "days": (0.75, 1.0),
}
"""How much weekends, and single weekdays, may differ, as a share of SCALE."""

DECAY: Final[dict[Detail, tuple[float, float]]] = {"smooth": (2.0, 2.0), "sharp": (16.0, 1.5)}
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
PHASES: Final = 12
OVERTONES: Final = 3
"""A period that is no part of the week is folded into so many phases and fitted with so many harmonics."""
N_WAVES: Final = int(CYCLES_A_WEEK.size)
FREQUENCY_HZ: Final = CYCLES_A_WEEK / WEEK_S
GATE: Final = np.where(KIND == 1, WEEKEND, EVERY_DAY).astype(np.uint8)


def table(period_s: float | None) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """Frequencies and gates of all waves, those of a period last."""
    if period_s is None:
        return FREQUENCY_HZ, GATE
    more = np.arange(1, OVERTONES + 1) / period_s
    return np.append(FREQUENCY_HZ, more), np.append(GATE, np.full(OVERTONES, EVERY_DAY, np.uint8))


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
def penalties(prior: Prior, period: bool = False) -> NDArray[np.float32]:
    """The penalty of every column of the design; infinite for waves that the prior leaves out."""
    variance = np.where(variances(prior) < NEGLIGIBLE, 0, variances(prior))
    if period:
        variance = np.append(variance, SCALE**2 / np.arange(1, OVERTONES + 1) ** 2)
    both = np.concatenate(([INTERCEPT_SD**2], variance, variance))
    penalty = np.full(both.size, np.inf)
    np.divide(1, both, out=penalty, where=both > 0)
    return penalty.astype(np.float32)


@lru_cache(maxsize=64)
def design(offset_s: float, period: bool = False) -> NDArray[np.float32]:
    """(SLOTS, 1 + 2 N_WAVES): a one, then gate · cos and gate · sin of every wave, `offset_s` into every slot.

    With a period (SLOTS · PHASES, 1 + 2 (N_WAVES + OVERTONES)): its waves last, its phases fastest.
    """
    tau_s = np.asarray(SLOT_S * np.arange(SLOTS) + offset_s, np.float64)
    plain = columns(tau_s)
    if not period:
        return plain.astype(np.float32)
    one, cosine, sine = np.split(np.repeat(plain, PHASES, axis=0), [1, 1 + N_WAVES], axis=1)
    angle = 2 * np.pi * (np.arange(PHASES)[:, np.newaxis] + 0.5) / PHASES * np.arange(1, OVERTONES + 1)
    more = [np.tile(wave, (SLOTS, 1)) for wave in (np.cos(angle), np.sin(angle))]
    return np.concatenate((one, cosine, more[0], sine, more[1]), axis=1).astype(np.float32)


def columns(tau_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same at any civil seconds (n,) since a Monday midnight."""
    angle = 2 * np.pi * ((tau_s[:, np.newaxis] % WEEK_S) * FREQUENCY_HZ)
    passed = (GATE == EVERY_DAY) | ((tau_s // DAY_S % 7) >= 5)[:, np.newaxis]
    return np.concatenate((np.ones((tau_s.size, 1)), np.cos(angle) * passed, np.sin(angle) * passed), axis=1)

"""Which silence is longer than usual, on a clock, on working hours and on chance."""

import numpy as np
import pytest
from numpy.typing import NDArray

from tidemap.spectral.rhythm import MIN_EXPECTED, WEEKS, Rhythm

A_DAY, WEEK, WIDTH_S = 288, 2016, 300.0


def civil(first: int, n: int) -> NDArray[np.float64]:
    return np.asarray(WIDTH_S * np.arange(first, first + n), np.float64)


def rhythm_of(heard: NDArray[np.bool_]) -> Rhythm:
    return Rhythm.of(heard, civil(0, len(heard)))


def test_what_speaks_like_a_clock_is_missed_soon() -> None:
    rhythm = rhythm_of(np.ones(WEEKS * WEEK, np.bool_))
    assert rhythm.longest == MIN_EXPECTED
    assert rhythm.silence(civil(WEEKS * WEEK, 4)) == 4


def test_of_the_hours_in_which_nothing_is_heard_nothing_is_expected() -> None:
    time = civil(0, WEEKS * WEEK)
    rhythm = rhythm_of((time % 86_400 >= 9 * 3600) & (time % 86_400 < 17 * 3600) & (time % 604_800 < 5 * 86_400))
    assert rhythm.silence(civil(WEEKS * WEEK - 2 * A_DAY, 2 * A_DAY + 9 * 12)) == 0
    assert rhythm.silence(civil(WEEKS * WEEK + 9 * 12, 12)) == 12


def test_one_day_is_no_rhythm() -> None:
    heard = np.zeros(3 * WEEK, np.bool_)
    heard[:A_DAY] = True
    assert rhythm_of(heard).silence(civil(3 * WEEK, WEEK)) == 0


@pytest.mark.parametrize("a_day", [3, 10, 60, 250])
@pytest.mark.parametrize("bursts", [1, 5])
def test_what_speaks_at_random_is_taken_for_silent_less_than_once_in_ten_weeks(a_day: int, bursts: int) -> None:
    """Judged over weeks that it has not learned from; in bursts, and more by day than by night."""
    chance = np.random.default_rng(a_day + bursts)
    by_day = np.where((civil(0, 14 * WEEK) % 86_400 - 43_200) ** 2 < 28_800**2, 1.4, 0.2)
    rate = np.repeat(chance.gamma(1 / bursts, bursts, -(-14 * WEEK // 6)), 6)[: 14 * WEEK]
    heard = chance.random(14 * WEEK) < 1 - np.exp(-a_day / A_DAY * by_day * rate)
    alarms = 0
    for week in range(WEEKS, 14):
        learned = heard[(week - WEEKS) * WEEK : week * WEEK]
        first = (week - WEEKS) * WEEK
        rhythm = Rhythm.of(learned, civil(first, len(learned)))
        at = np.flatnonzero(heard[week * WEEK : (week + 1) * WEEK])
        alarms += sum(
            rhythm.silence(civil(week * WEEK + a + 1, b - a - 1)) > rhythm.longest
            for a, b in zip(at[:-1].tolist(), at[1:].tolist(), strict=True)
        )
    assert alarms <= 1
    assert rhythm.silence(civil(14 * WEEK, 2 * WEEK)) > rhythm.longest, "but for ever it is"

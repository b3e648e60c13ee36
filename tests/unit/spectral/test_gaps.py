"""Long gaps: weeks in which nothing was seen neither age a rhythm nor are it."""

import math

import numpy as np
import pytest

from tests.unit.spectral.real import MONDAY
from tests.unit.spectral.test_calendar import same
from tidemap.history.history import UNOBSERVED, History
from tidemap.history.timebase import TimeBase
from tidemap.spectral.auto.selection import choose
from tidemap.spectral.auto.trials import task
from tidemap.spectral.calendar import folding
from tidemap.spectral.estimators import fit_recipe
from tidemap.spectral.prediction import predict_times
from tidemap.spectral.recipe import Prior, Recipe
from tidemap.spectral.window import fft_window

BASE = TimeBase(MONDAY, 600.0)
DAY = 144
WEEK = 7 * DAY
RHYTHM, GAP = 4 * WEEK, 30 * WEEK


def weekdays(n_samples: int) -> np.ndarray:
    """Open from 8 to 18 on weekdays, (1, n_samples)."""
    sample = np.arange(n_samples)
    hour, day = sample % DAY / 6, sample // DAY % 7
    return ((hour >= 8) & (hour < 18) & (day < 5)).astype(np.uint8)[np.newaxis]


def gapped(after: int) -> History:
    """Four weeks, thirty of nothing, and some more samples."""
    states = weekdays(RHYTHM + GAP + after)
    states[:, RHYTHM : RHYTHM + GAP] = UNOBSERVED
    return History.from_states(states)


def wrong_next_week(history: History, recipe: Recipe) -> float:
    window = (history.start, history.stop)
    if recipe.estimator == "fft":
        window = fft_window(history.seen(), *window, BASE.interval_s)
    ahead = np.arange(history.stop, history.stop + WEEK)
    p = predict_times(fit_recipe(history.window(*window), recipe, BASE), BASE.time(ahead))[0]
    return float(np.mean((p > 0.5) != weekdays(history.stop + WEEK)[0, ahead]))


@pytest.mark.parametrize("after", [1, 3 * DAY, 9 * DAY])
def test_4_auto_knows_the_rhythm_after_a_long_gap(after: int) -> None:
    history = gapped(after)
    chosen = choose(history, BASE, time_zone="UTC")
    assert chosen.estimator == "calendar"
    assert wrong_next_week(history, chosen.recipe) <= 0.01
    without = choose(history, BASE)
    assert without.estimator == "fft"
    assert wrong_next_week(history, without.recipe) <= 0.05


@pytest.mark.parametrize("after", [1, 3 * DAY])
@pytest.mark.parametrize(
    "recipe",
    [
        Recipe("calendar", 16),
        Recipe("calendar", 64, priors=(Prior(half_life_days=7.0),), carry_over=1.0, level_sd=0.4),
        Recipe("fft", 10),
    ],
)
def test_4_every_estimator_knows_it(after: int, recipe: Recipe) -> None:
    """As well as without the gap."""
    states = weekdays(RHYTHM + after)
    assert wrong_next_week(gapped(after), recipe) <= wrong_next_week(History.from_states(states), recipe) + 0.01


def test_a_gap_of_whole_weeks_does_not_age_a_rhythm() -> None:
    whole = weekdays(RHYTHM)
    states = np.full((1, RHYTHM + GAP), UNOBSERVED, np.uint8)
    states[:, : RHYTHM // 2], states[:, RHYTHM // 2 + GAP :] = np.split(whole, 2, axis=1)
    recipe = Recipe("calendar", 16, priors=(Prior(half_life_days=7.0), Prior(half_life_days=math.inf)))
    same(*(fit_recipe(History.from_states(each), recipe, BASE) for each in (whole, states)))


def test_trials_are_made_of_days_on_which_something_was_seen() -> None:
    made = task(gapped(3 * DAY), BASE, "UTC", 8)
    assert made.visits.n_days == 31
    assert made.visits.date.tolist() == [*range(28), *range(7 * 34, 7 * 34 + 3)]
    days = [trial.last - trial.first for trial in made.trials]
    np.testing.assert_allclose(made.truth.n_observed.sum(axis=(1, 2)), 96 * np.array(days), rtol=1e-6)
    slot, time = made.times(made.trials[-1])
    assert slot.size == 3 * 96
    np.testing.assert_array_equal(time // 86_400 - MONDAY / 86_400, np.repeat(7 * 34 + np.arange(3), 96))


def test_half_a_year_in_which_something_was_seen_is_folded() -> None:
    base = TimeBase(MONDAY, 3600.0)
    states = np.full((1, 24 * 7 * 80), UNOBSERVED, np.uint8)
    for week in range(80):
        states[0, week * 168 : week * 168 + 72] = week % 2
    recent = folding.recent(History.from_states(states), base)
    assert folding.visits(recent, base, "UTC").n_days == folding.MAX_DAYS
    assert recent.n_samples > 60 * 168
    few = History.from_states(states[:, : 50 * 168])
    assert folding.recent(few, base) is few


@pytest.mark.parametrize(
    ("seen", "part"),
    [
        (np.r_[0:RHYTHM, RHYTHM + GAP], (0, RHYTHM)),
        (np.r_[0, RHYTHM + GAP : 2 * RHYTHM + GAP], (RHYTHM + GAP, 2 * RHYTHM + GAP)),
        (np.r_[0:RHYTHM, 2 * RHYTHM : 3 * RHYTHM], (0, 3 * RHYTHM)),
        (np.r_[0:DAY, 7 * DAY : 8 * DAY], (0, 8 * DAY)),
        (np.r_[0:DAY, 9 * DAY : 12 * DAY], (9 * DAY, 12 * DAY)),
        (np.r_[100], (100, 100 + DAY)),
        (np.r_[3 * WEEK : 5 * WEEK], (3 * WEEK, 5 * WEEK)),
    ],
)
def test_the_window_of_fft_is_not_mostly_a_pause(seen: np.ndarray, part: tuple[int, int]) -> None:
    stop = max(part[1], int(seen[-1]) + 1)
    assert fft_window(seen, 0, stop, 600.0) == part

"""Level: the last day's departure from the rhythm, and doubt of a level learned from few weeks."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.unit.spectral.real import MONDAY
from tidemap.history.history import UNOBSERVED, History
from tidemap.history.timebase import TimeBase
from tidemap.spectral.auto.selection import choose
from tidemap.spectral.calendar import level
from tidemap.spectral.estimators import fit_recipe
from tidemap.spectral.evaluation import score
from tidemap.spectral.prediction import predict_times
from tidemap.spectral.recipe import Prior, Recipe

BASE, DAY = TimeBase(MONDAY, 900.0), 96
PLAIN = Recipe("calendar", 64, "UTC", (Prior(week="day", half_life_days=math.inf),))


def moody(days: int, memory: float, seed: int = 0) -> History:
    """One cell, occupied by day, whose level on the logit scale goes up and down and is remembered from day to day."""
    random = np.random.default_rng(seed)
    mood = np.zeros(days)
    for day in range(1, days):
        mood[day] = memory * mood[day - 1] + math.sqrt(1 - memory**2) * random.normal()
    hour = np.arange(days * DAY) % DAY / 4
    eta = 2 * np.sin(2 * np.pi * (hour - 8) / 24) - 1 + 1.5 * np.repeat(mood, DAY)
    return History.from_states((random.random((1, eta.size)) < 1 / (1 + np.exp(-eta))).astype(np.uint8))


def test_departures_are_the_likeliest_within_bounds() -> None:
    random = np.random.default_rng(1)
    eta = random.normal(0, 3, (50, 672)).astype(np.float32)
    seen = (random.random((50, 672)) * (random.random((50, 1)) < 0.8) * random.uniform(0, 1, (50, 1))).astype(
        np.float32
    )
    truth = 1 / (1 + np.exp(-eta - random.normal(0, 1, (50, 1))))
    full = (seen * (random.random(truth.shape) < truth)).astype(np.float32)
    tried = np.linspace(-level.MAX_DEPARTURE, level.MAX_DEPARTURE, 401)
    logit = eta[..., np.newaxis].astype(np.float64) + tried
    gain = (full[..., np.newaxis] * logit - seen[..., np.newaxis] * np.logaddexp(0, logit)).sum(axis=1)
    best = tried[np.argmax(gain - 0.5 * level.VISITS * tried**2, axis=1)]
    found = level.departures(eta, seen, full)
    np.testing.assert_allclose(found, best, atol=0.006)
    assert np.all(found[seen.sum(axis=1) == 0] == 0)
    np.testing.assert_allclose(level.departures(-eta, seen, seen - full), -found, atol=1e-4)


@pytest.mark.parametrize("days", [2, 7, 14, 56])
@pytest.mark.parametrize("logit", [-4.0, -1.0, 0.3, 2.5])
def test_caution_is_the_mean_over_levels(days: int, logit: float) -> None:
    doubt = 0.6
    sd = doubt * math.sqrt(7 / days)
    level_s = np.linspace(-6, 6, 2001)
    weight = np.exp(-0.5 * level_s**2)
    mean = float(weight @ (1 / (1 + np.exp(-logit - sd * level_s))) / weight.sum())
    factor = float(level.caution(doubt, np.array([days]))[0])
    assert 1 / (1 + math.exp(-logit * factor)) == pytest.approx(mean, abs=0.006)
    assert float(level.caution(0.0, np.array([days]))[0]) == 1


def test_doubt_draws_to_a_half_the_less_the_more_days_were_seen() -> None:
    states = moody(70, 0.0).states()
    states[:, 7 * DAY : 63 * DAY] = UNOBSERVED
    time = BASE.time(np.arange(7 * DAY))
    away = {}
    for name, history in (("gap", History.from_states(states)), ("full", moody(70, 0.0))):
        sure, doubtful = (
            predict_times(fit_recipe(history, Recipe("calendar", 64, "UTC", PLAIN.priors, level_sd=doubt), BASE), time)
            for doubt in (0.0, 0.7)
        )
        assert np.all(np.abs(doubtful - 0.5) <= np.abs(sure - 0.5) + 1e-6)
        away[name] = float(np.abs(doubtful - sure).max())
    assert away["full"] < 0.3 * away["gap"]


@pytest.mark.parametrize(("days", "left"), [(1, 0.2835), (3, 0.486), (7, 1.0)])
def test_less_outlasts_a_week_than_the_next_day(days: int, left: float) -> None:
    assert level.outlasting(days) == pytest.approx(left, abs=1e-3)


def test_two_weeks_that_end_with_a_mood_say_little_of_the_week_to_come() -> None:
    """Every trial of theirs is of one day: it shows how far the next day is like the last."""
    assert choose(moody(14, 0.95, 3), BASE, time_zone="UTC").carry_over <= level.outlasting(1)


def test_a_departure_is_followed_as_far_as_asked() -> None:
    states = moody(21, 0.0).states()
    states[:, -DAY:] = 0
    history = History.from_states(states)
    time = BASE.time(np.arange(21 * DAY, 28 * DAY))
    mean = [
        float(
            predict_times(
                fit_recipe(history, Recipe("calendar", 64, "UTC", PLAIN.priors, carry_over=f), BASE), time
            ).mean()
        )
        for f in (0.0, 0.5, 1.0)
    ]
    assert mean[0] > mean[1] + 0.02 > mean[2] + 0.04


def test_auto_follows_moods_that_last_and_no_others() -> None:
    follow = {
        memory: [choose(moody(56, memory, seed), BASE, time_zone="UTC").carry_over for seed in range(6)]
        for memory in (0.0, 0.95)
    }
    assert np.mean(follow[0.0]) < 0.3
    assert np.mean(follow[0.95]) > 0.6


def test_following_predicts_better_where_moods_last() -> None:
    gain = []
    for seed in range(8):
        history = moody(77, 0.95, seed)
        recipe = choose(history.window(0, 56 * DAY), BASE, time_zone="UTC").recipe
        for first in (56 * DAY, 63 * DAY, 70 * DAY):
            followed, steady = (
                _next_week(history, first, replace(recipe, carry_over=share, level_sd=0.0))
                for share in (recipe.carry_over, 0.0)
            )
            gain.append(math.log(steady / followed))
    assert np.mean(gain) > 0.005


def _next_week(history: History, first: int, recipe: Recipe) -> float:
    ahead = np.arange(first, first + 7 * DAY)
    p = predict_times(fit_recipe(history.window(0, first), recipe, BASE), BASE.time(ahead))
    return score(p, history.states()[:, ahead]).log_loss

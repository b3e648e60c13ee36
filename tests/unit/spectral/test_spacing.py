"""How far observations are apart, and the frequencies that they can tell."""

import numpy as np
import pytest

from tidemap.history.history import History
from tidemap.history.timebase import TimeBase
from tidemap.spectral.auto.selection import choose
from tidemap.spectral.calendar.periods import find_period
from tidemap.spectral.estimators import fit, fit_recipe
from tidemap.spectral.evaluation import score
from tidemap.spectral.prediction import predict_times
from tidemap.spectral.recipe import Recipe
from tidemap.spectral.spacing import spacing
from tidemap.spectral.spectrum import components, static

MINUTES = TimeBase(0.0, 60.0)
DAY_S = 86_400


def seen_at(samples: np.ndarray, n_samples: int) -> History:
    states = np.full((1, n_samples), 2, np.uint8)
    states[0, samples] = samples // 7 % 2
    return History.from_states(states)


def apart(samples: np.ndarray, n_samples: int) -> float:
    return float(spacing(seen_at(samples, n_samples), np.array([0]))[0])


def test_of_regular_visits_it_is_their_distance_whatever_jitter_and_pauses() -> None:
    random = np.random.default_rng(3)
    regular = np.arange(0, 40_000, 10)
    assert apart(regular, 40_000) == 10
    assert apart((regular * 60 + random.uniform(0, 60, regular.size)).astype(int) // 60, 40_000) == 10
    assert apart(regular + random.integers(-1, 2, regular.size) + 1, 40_010) == pytest.approx(10, abs=0.01)
    assert apart(regular[regular % 1440 < 600], 40_000) == 10
    assert apart(np.arange(0, 60_000, 90) // 60, 1000) == pytest.approx(1.5, abs=0.5)
    assert apart(np.array([5, 80]), 100) == 75


def test_of_visits_at_random_it_is_less_than_their_mean_distance() -> None:
    random = np.random.default_rng(4)
    visits = np.unique(random.integers(0, 28 * 1440, 80))
    assert 1 <= apart(visits, 28 * 1440) < 28 * 1440 / 80 / 2


def test_most_samples_observed_tell_every_frequency() -> None:
    random = np.random.default_rng(5)
    for share in (0.5, 0.7, 0.95, 1.0):
        assert apart(np.flatnonzero(random.random(3000) < share), 3000) == 1
    assert apart(np.array([5]), 100) == 1


@pytest.mark.parametrize("jitter_s", [0, 30])
def test_2_aliases(jitter_s: int) -> None:
    """A door open from 8 to 18, seen every ten minutes: no period under twenty, few minutes wrong."""
    random = np.random.default_rng(jitter_s)
    time = np.arange(600, 28 * DAY_S, 600) + random.uniform(-jitter_s, jitter_s, 28 * 144 - 1)
    open_at = (time % DAY_S >= 8 * 3600) & (time % DAY_S < 18 * 3600)
    sample = MINUTES.sample(time)
    history = History.from_measurements(1, 0, 28 * 1440, np.zeros(sample.size), sample, open_at.astype(np.uint8))
    spectrum = fit(history, "fft", 2, MINUTES)
    assert (1 / components(spectrum, 0).frequency_hz).min() >= 1200
    minute = np.arange(28 * 1440)
    truth = (minute % 1440 >= 480) & (minute % 1440 < 1080)
    p = predict_times(spectrum, MINUTES.time(minute))[0]
    assert np.mean((p > 0.5) != truth) <= 0.04
    seen = history.states()[0]
    assert np.mean((p > 0.5) != truth) == pytest.approx(np.mean(((p > 0.5) != seen)[seen != 2]), abs=0.02)


def visited(every: int, days: int, jitter: int = 0, seed: int = 0) -> tuple[np.ndarray, History]:
    """A door open from 8 to 18 on weekdays per minute, from a Monday, and what visits see of it with 3 % noise."""
    random = np.random.default_rng(seed)
    minute = np.arange(days * 1440)
    truth = (minute % 1440 >= 480) & (minute % 1440 < 1080) & (minute // 1440 % 7 < 5)
    at = np.arange(every - 1, minute.size, every)
    at = np.clip(at + random.integers(-jitter, jitter + 1, at.size), 0, minute.size - 1)
    states = np.full((1, minute.size), 2, np.uint8)
    states[0, at] = truth[at] ^ (random.random(at.size) < 0.03)
    return truth, History.from_states(states)


@pytest.mark.parametrize(("every", "jitter"), [(60, 0), (60, 10), (180, 0), (480, 60), (1440, 0)])
def test_no_wave_of_calendar_is_faster_than_what_visits_tell(every: int, jitter: int) -> None:
    _, history = visited(every, 28, jitter)
    base = TimeBase(4.0 * DAY_S, 60.0)
    for recipe in (Recipe("calendar", 145), choose(history, base, time_zone="UTC").recipe):
        period_s = 1 / np.maximum(components(fit_recipe(history, recipe, base), 0).frequency_hz, 1e-12)
        assert period_s.min(initial=np.inf) > 2 * 0.9 * 60 * every


@pytest.mark.parametrize(("every", "wrong", "log_loss"), [(60, 0.02, 0.085), (180, 0.07, 0.18)])
def test_a_door_seen_now_and_then_is_known_between_the_visits(every: int, wrong: float, log_loss: float) -> None:
    """Hardly worse than halfway between two visits that differ."""
    truth, history = visited(every, 49)
    base, past, ahead = TimeBase(4.0 * DAY_S, 60.0), history.window(0, 42 * 1440), np.arange(42 * 1440, 49 * 1440)
    p = predict_times(fit_recipe(past, choose(past, base, time_zone="UTC").recipe, base), base.time(ahead))[0]
    found = score(p, truth[ahead])
    assert found.error <= wrong
    assert found.log_loss <= log_loss


@pytest.mark.parametrize("seed", range(5))
def test_of_a_period_and_its_aliases_the_period_is_found(seed: int) -> None:
    random = np.random.default_rng(seed)
    base, n_samples = TimeBase(4.0 * DAY_S, 60.0), 28 * 1440
    at = np.clip(np.arange(0, n_samples, 60) + random.integers(-3, 4, n_samples // 60), 0, n_samples - 1)
    states = np.full((2, n_samples), 2, np.uint8)
    states[:, at] = (at % (36 * 60) < 12 * 60) ^ (random.random((2, at.size)) < 0.1)
    states[1, at[::2]] = 2
    mean = static(np.full(2, 0.33, np.float32), base)
    assert find_period(History.from_states(states), mean, base) == pytest.approx(36 * 3600, rel=0.01)

"""Anomalies, evaluation, windows, the time base and `auto`."""

import numpy as np
import pytest

from tidemap.history.history import History
from tidemap.history.timebase import TimeBase
from tidemap.spectral.anomaly import is_anomalous, surprise
from tidemap.spectral.auto.selection import choose
from tidemap.spectral.evaluation import expected_calibration_error, reliability, score
from tidemap.spectral.window import fit_window

HOURLY = TimeBase(0.0, 3600.0)


def test_surprise_and_both_rules() -> None:
    p, s = np.array([0.0, 0.96, 0.5, np.nan]), np.array([1, 0, 1, 1])
    np.testing.assert_allclose(surprise(p, s), [1, 0.96, 0.5, np.nan])
    assert is_anomalous(p, s, 0.95).tolist() == [True, True, False, False]
    assert is_anomalous(p, s, 0.95, "paper").tolist() == [True, True, True, False]
    with pytest.raises(ValueError, match="unknown rule"):
        is_anomalous(p, s, 0.9, "guess")  # type: ignore[arg-type]


def test_scores_leave_out_what_cannot_be_scored() -> None:
    scores = score([0.8, 0.2, 0.9, np.nan], [1, 1, 2, 1])
    assert scores.n == 2
    assert scores.error == 0.5
    assert scores.brier == pytest.approx((0.04 + 0.64) / 2)
    assert scores.log_loss == pytest.approx(-(np.log(0.8) + np.log(0.2)) / 2)
    assert score([], []).n == 0
    with pytest.raises(ValueError, match="shape"):
        score([0.5], [1, 0])


def test_wrong_certainty_costs_a_bounded_log_loss() -> None:
    assert score([1.0], [0]).log_loss == pytest.approx(-np.log(1e-3))


def test_reliability_of_calibrated_and_of_overconfident_probabilities() -> None:
    random = np.random.default_rng(0)
    p = random.random(20_000)
    s = (random.random(p.size) < p).astype(np.uint8)
    table = reliability(p, s)
    assert table.count.sum() == p.size
    assert expected_calibration_error(table) < 0.02
    assert expected_calibration_error(reliability(np.round(p), s)) == pytest.approx(0.25, abs=0.02)
    assert np.isnan(expected_calibration_error(reliability([], [])))
    assert reliability([1.0], [1]).count[-1] == 1


@pytest.mark.parametrize("days", [1.0, 1.5, 2.5, 13.9, 14.0, 30.0])
@pytest.mark.parametrize("interval_s", [1.0, 60.0, 300.0, 7.0])
def test_the_daily_frequency_falls_on_a_bin(days: float, interval_s: float) -> None:
    stop = 1000 + round(days * 86_400 / interval_s + 0.5)
    first, last = fit_window(1000, stop, interval_s)
    assert (first >= 1000, last) == (True, stop)
    cycles = (last - first) * interval_s / 86_400
    assert cycles == pytest.approx(round(cycles), abs=interval_s / 86_400)
    assert round(cycles) % 7 == 0 or cycles < 14


def test_the_start_of_a_sample_belongs_to_it() -> None:
    for interval_s in (0.1, 1 / 30, 60.0, 300.7):
        base = TimeBase(1.7e9 + 0.3, interval_s)
        samples = np.arange(-50_000, 50_000, 7)
        np.testing.assert_array_equal(base.sample(base.time(samples)), samples)
    with pytest.raises(ValueError, match="interval_s > 0"):
        TimeBase(0.0, 0.0)


def daily(days: int) -> History:
    hour = np.arange(days * 24)
    states = ((hour % 24 >= 8) & (hour % 24 < 18)).astype(np.uint8)
    return History.from_states(np.stack((states, 1 - states, np.zeros_like(states))))


def test_auto_finds_a_daily_rhythm() -> None:
    chosen = choose(daily(20), HOURLY)
    assert chosen.estimator == "fft"
    assert chosen.cells == 2
    loss = {row.order: row.log_loss for row in chosen.table}
    assert loss[chosen.order] < 0.02 * loss[0]
    assert "of 7 candidates" in chosen.reason


def test_auto_takes_the_mean_of_noise() -> None:
    states = (np.random.default_rng(4).random((20, 24 * 14)) < 0.3).astype(np.uint8)
    assert choose(History.from_states(states), HOURLY).estimator == "static"


def few_readings(n: int) -> History:
    """So many, over months."""
    states = np.full((1, 60 * n), 2, np.uint8)
    states[0, ::60] = np.arange(n) % 2
    return History.from_states(states)


@pytest.mark.parametrize(
    ("history", "reason"),
    [
        (daily(1), "less than 2 days"),
        (daily(5).cells([2]), "no cell has changed"),
        (History.empty(3), "less than 2 days"),
        (daily(1).window(-400, 24), "seen on less than 2 days"),
        (few_readings(23), "only 23 readings"),
    ],
)
def test_auto_says_why_it_cannot_try(history: History, reason: str) -> None:
    chosen = choose(history, HOURLY)
    assert (chosen.estimator, chosen.order) == ("static", 0)
    assert reason in chosen.reason


def test_auto_tries_what_was_seen_whatever_lies_between() -> None:
    assert choose(few_readings(24), HOURLY).table
    assert choose(daily(4).window(0, 400), HOURLY).estimator == "fft"


def test_auto_repeats_itself() -> None:
    history = History.from_states(np.random.default_rng(9).integers(0, 3, (90, 24 * 8)).astype(np.uint8))
    assert choose(history, HOURLY, max_cells=7) == choose(history, HOURLY, max_cells=7)

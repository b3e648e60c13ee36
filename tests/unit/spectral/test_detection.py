"""Learning how often a sensor errs, and how long states last."""

import numpy as np
import pytest
from numpy.typing import NDArray

from tidemap.history.history import UNOBSERVED, History
from tidemap.history.sequences import Sequences
from tidemap.history.timebase import TimeBase
from tidemap.spectral.detection import BELIEVED, MIN_READINGS, ReadCells, learn_detector
from tidemap.spectral.detector import Detector
from tidemap.spectral.durations import BelievedRuns, Durations
from tidemap.spectral.estimators import fit
from tidemap.spectral.prediction import predict_readings, predict_times
from tidemap.spectral.sensor import Sensor

MINUTES = TimeBase(0.0, 60.0)


def lasting(n_samples: int, random: np.random.Generator, free: int = 60, occupied: int = 20) -> NDArray[np.uint8]:
    """Free and occupied for about as many samples as said, in turns."""
    lengths = np.array([free, occupied] * n_samples)[:n_samples] * random.uniform(0.9, 1.1, n_samples)
    return np.repeat(np.arange(n_samples) % 2, lengths.astype(int))[:n_samples].astype(np.uint8)


def read_by(
    truth: NDArray[np.uint8], sensor: Sensor, random: np.random.Generator, seen: float = 1.0
) -> NDArray[np.uint8]:
    """What a sensor reads, of a share of the samples."""
    wrong = random.random(truth.shape) < np.where(truth == 1, sensor.miss, sensor.false_alarm)
    return np.where(random.random(truth.shape) < seen, truth ^ wrong, UNOBSERVED).astype(np.uint8)


def learned(states: NDArray[np.uint8], given: Sensor | None = None) -> Detector:
    history = History.from_states(np.atleast_2d(states))
    sequences = Sequences.of(history)
    p = predict_readings(fit(history, "static", 0, MINUTES), np.arange(history.n_cells), sequences, MINUTES)
    return learn_detector(ReadCells(sequences, p.astype(np.float64)), 60.0, given)


@pytest.mark.parametrize("true", [Sensor(0.1, 0.1), Sensor(0.25, 0.03), Sensor(0.02, 0.2), Sensor(0.0, 0.0)])
@pytest.mark.parametrize("seen", [1.0, 0.4])
def test_the_rates_are_found(true: Sensor, seen: float) -> None:
    random = np.random.default_rng(3)
    found = learned(read_by(lasting(20_000, random), true, random, seen))
    assert found.sensor.miss == pytest.approx(true.miss, abs=0.03)
    assert found.sensor.false_alarm == pytest.approx(true.false_alarm, abs=0.03)
    assert found.readings > 7000
    assert "were learned from" in found.reason


def test_how_long_states_last_is_found() -> None:
    random = np.random.default_rng(5)
    found = learned(read_by(lasting(20_000, random), Sensor(0.1, 0.1), random)).durations
    assert float(found.kept(1, 5, 5)) > 0.9
    assert float(found.kept(1, 10, 15)) < 0.3
    assert float(found.kept(0, 20, 20)) > 0.8
    assert float(found.kept(0, 20, 50)) < 0.3


def test_rates_that_are_given_stay() -> None:
    random = np.random.default_rng(7)
    states = read_by(lasting(5000, random), Sensor(0.1, 0.1), random)
    found = learned(states, Sensor(0.15, 0.05))
    assert (found.sensor, found.readings, found.reason) == (Sensor(0.15, 0.05), 0, "the rates were given")
    assert float(found.durations.kept(1, 10, 15)) < 0.4


@pytest.mark.parametrize("n", [0, 1, MIN_READINGS - 1])
def test_too_few_readings_say_so(n: int) -> None:
    random = np.random.default_rng(9)
    states = np.full(1000, UNOBSERVED, np.uint8)
    states[:n] = random.integers(0, 2, n)
    found = learned(states)
    assert (found.sensor, found.readings) == (BELIEVED, 0)
    assert found.reason.startswith(f"{n} readings are too few")


def test_of_states_that_never_change_one_rate_is_found_and_the_other_believed() -> None:
    random = np.random.default_rng(11)
    found = learned(read_by(np.ones((3, 3000), np.uint8), Sensor(0.1, 0.3), random))
    assert found.sensor.miss == pytest.approx(0.1, abs=0.02)
    assert found.sensor.false_alarm == pytest.approx(BELIEVED.false_alarm, abs=0.02)


def test_cells_that_the_model_does_not_know_say_nothing() -> None:
    random = np.random.default_rng(13)
    states = read_by(np.tile(lasting(2000, random), (2, 1)), Sensor(0.1, 0.1), random)
    sequences = Sequences.of(History.from_states(states))
    p = np.where(sequences.cell == 0, 0.3, np.nan)
    found = learn_detector(ReadCells(sequences, p), 60.0)
    assert found.readings == 2000
    assert "of 1 cell" in found.reason


def test_runs_that_go_on_hold_the_hazard_down() -> None:
    ended = BelievedRuns(np.ones(40, np.uint8), np.full(40, 30.0), np.ones(40, np.bool_), np.ones(40))
    going_on = BelievedRuns(np.ones(80, np.uint8), np.full(80, 30.0), np.arange(80) < 40, np.ones(80))
    never = BelievedRuns(np.ones(40, np.uint8), np.full(40, 500.0), np.zeros(40, np.bool_), np.ones(40))
    kept = [float(Durations.learned(runs, 60.0).kept(1, 10, 25)) for runs in (ended, going_on, never)]
    assert kept[0] < 0.15 < kept[1] < 0.9 < kept[2]
    nothing = BelievedRuns(np.zeros(0, np.uint8), np.zeros(0), np.zeros(0, np.bool_), np.zeros(0))
    np.testing.assert_allclose(Durations.learned(nothing, 60.0).log_kept, Durations.believed(60.0).log_kept)


def test_of_a_state_that_is_often_drawn_again_more_is_redrawn_than_ends() -> None:
    ends = [
        BelievedRuns(np.ones(40, np.uint8), np.full(40, 30.0), np.ones(40, np.bool_), np.full(40, p))
        for p in (1.0, 0.1)
    ]
    kept = [float(Durations.learned(runs, 60.0).kept(1, 4, 26)) for runs in ends]
    assert kept[1] < kept[0]


def test_beyond_the_table_it_is_a_power_of_the_age() -> None:
    durations = Durations.believed(86_400.0)
    assert float(durations.kept(0, 9000, 1000)) == pytest.approx(0.1, rel=0.01)


def test_what_is_read_is_predicted_as_by_times(monkeypatch: pytest.MonkeyPatch) -> None:
    random = np.random.default_rng(15)
    history = History.from_states(random.integers(0, 3, (5, 900)).astype(np.uint8), start=100)
    for estimator in ("static", "fft", "calendar"):
        spectrum = fit(history, estimator, 5, MINUTES)
        rows = np.array([4, 1, 2])
        some = Sequences.of(history.cells(rows))
        for size in (1 << 20, 64):
            monkeypatch.setattr("tidemap.spectral.prediction.TABLE_SIZE", size)
            found = predict_readings(spectrum, rows, some, MINUTES)
            every = predict_times(spectrum, MINUTES.time(np.arange(100, 1000)), rows)
            np.testing.assert_allclose(found, every[some.cell, some.sample - 100], atol=1e-6)
    assert not predict_readings(spectrum, [], Sequences.joined(0, []), MINUTES).size

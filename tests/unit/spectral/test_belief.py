"""What is believed of cells that a sensor reads which errs."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tidemap.history.history import NEVER, UNOBSERVED, History
from tidemap.history.sequences import Sequences
from tidemap.spectral.belief import MAX_AGE, Beliefs
from tidemap.spectral.conditioning import Standing, condition
from tidemap.spectral.detector import Detector
from tidemap.spectral.durations import Durations
from tidemap.spectral.sensor import Sensor

RATE = st.floats(0, 0.49)
STATES = hnp.arrays(np.uint8, st.tuples(st.just(3), st.integers(1, 60)), elements=st.integers(0, 2))
MINUTE = Durations.believed(60.0)


def detector(miss: float = 0.1, false_alarm: float = 0.2) -> Detector:
    return Detector(Sensor(miss, false_alarm), MINUTE)


def after(states: list[int], rates: Detector, p: float = 0.45) -> Beliefs:
    """What is believed of one cell after these samples."""
    sequences = Sequences.of(History.from_states(np.array([states], np.uint8)))
    return Beliefs.none(1, rates).filtered(sequences, np.full(len(sequences.sample), p, np.float32))


@given(miss=RATE, false_alarm=RATE, p=st.floats(0.01, 0.99), read=st.sampled_from([0, 1]))
def test_the_first_reading_is_weighed_by_bayes(miss: float, false_alarm: float, p: float, read: int) -> None:
    rates = detector(miss, false_alarm)
    miss, false_alarm = rates.sensor.bounded
    rhythm = float(rates.sensor.state_probability(np.float32(p)))
    rhythm = min(max(rhythm, 1e-6), 1 - 1e-6)
    occupied = rhythm * (1 - miss if read else miss)
    free = (1 - rhythm) * (false_alarm if read else 1 - false_alarm)
    found = after([read], rates, p)
    assert found.probability[0] == pytest.approx(occupied / (occupied + free), rel=1e-4, abs=1e-9)
    assert found.state.tolist() == [read]


def test_the_answer_is_the_mixture_of_both_cases() -> None:
    rates, p = detector(), np.array([[0.3]], np.float32)
    now = after([1, 1], rates)
    later = 40
    at, rhythm = (float(rates.sensor.state_probability(each)) for each in (np.float32(0.45), p[0, 0]))
    kept = [float(MINUTE.kept(state, later - 1, now.age[state, 0] / 8)) for state in (0, 1)]
    cases = [condition(rhythm, at if state else 1 - at, state, kept[state]) for state in (0, 1)]
    expected = now.probability[0] * cases[1] + (1 - now.probability[0]) * cases[0]
    assert now.condition(p, np.array([later]))[0, 0] == pytest.approx(float(expected), abs=1e-6)


def test_a_sensor_that_never_errs_is_believed() -> None:
    found = after([0, 0, 1], detector(0.0, 0.0)).condition(np.full((1, 2), 0.5, np.float32), np.array([2, 3]))
    assert found[0, 0] > 0.99
    assert found[0, 1] > 0.95


def test_one_reading_against_many_is_no_news() -> None:
    p = np.full((1, 1), 0.5, np.float32)
    steady = after([1] * 30 + [0], detector(0.2, 0.2))
    assert steady.condition(p, np.array([30]))[0, 0] > 0.9
    changed = after([1] * 30 + [0] * 6, detector(0.2, 0.2))
    assert changed.condition(p, np.array([35]))[0, 0] < 0.1


def test_far_ahead_it_is_the_rhythm_of_the_state() -> None:
    p = np.array([[0.0, 0.2, 0.55, 0.9]], np.float32)
    found = after([1, 1, 1], detector()).condition(p, np.full(4, 10**8))
    np.testing.assert_allclose(found, detector().sensor.state_probability(p), atol=2e-3)


@given(states=STATES, cut=st.integers(0, 60), seed=st.integers(0, 99))
def test_going_on_is_beginning_anew_bit_for_bit(states: np.ndarray, cut: int, seed: int) -> None:
    sequences = Sequences.of(History.from_states(states))
    p = np.random.default_rng(seed).random(len(sequences.sample)).astype(np.float32)
    whole = Beliefs.none(3, detector()).filtered(sequences, p)
    parts = Beliefs.none(3, detector())
    for chosen in (sequences.sample < cut, sequences.sample >= cut):
        parts = parts.filtered(sequences.select(chosen), p[chosen])
    for mine, other in ((parts.signed, whole.signed), (parts.sample, whole.sample), (parts.p, whole.p)):
        np.testing.assert_array_equal(mine, other)
    np.testing.assert_array_equal(parts.age, whole.age)
    last = [np.flatnonzero(row != UNOBSERVED) for row in states]
    assert whole.sample.tolist() == [int(each[-1]) if each.size else NEVER for each in last]
    expected = [int(row[each[-1]]) if each.size else UNOBSERVED for row, each in zip(states, last, strict=True)]
    assert whole.state.tolist() == expected


@given(
    states=STATES,
    miss=RATE,
    false_alarm=RATE,
    p=st.floats(0, 1, width=32),
    asked=st.integers(-100, 10**9),
)
def test_it_is_always_a_probability(states: np.ndarray, miss: float, false_alarm: float, p: float, asked: int) -> None:
    sequences = Sequences.of(History.from_states(states))
    rhythm = np.full(len(sequences.sample), p, np.float32)
    now = Beliefs.none(3, detector(miss, false_alarm)).filtered(sequences, rhythm)
    found = now.condition(np.full((3, 1), p, np.float32), np.array([asked]))
    assert ((found >= 0) & (found <= 1)).all()


def test_before_the_reading_and_without_one_it_is_the_rhythm_of_the_state() -> None:
    rates, p = detector(), np.array([[0.3, 0.4]], np.float32)
    rhythm = rates.sensor.state_probability(p).astype(np.float32)
    np.testing.assert_array_equal(Beliefs.none(1, rates).condition(p, np.array([5, 6])), rhythm)
    known = after([2, 2, 1], rates)
    found = known.condition(p, np.array([1, 2]))
    assert found[0, 0] == rhythm[0, 0]
    assert found[0, 1] > rhythm[0, 1]
    np.testing.assert_array_equal(known.without(np.array([0])).condition(p, np.array([1, 2])), rhythm)


@given(states=STATES, hold=st.integers(0, 5), ahead=st.integers(0, 20))
def test_what_is_believed_after_every_reading_is_what_they_say_so_far(
    states: np.ndarray, hold: int, ahead: int
) -> None:
    sequences = Sequences.of(History.from_states(states))
    p = (0.2 + sequences.sample % 7 / 10).astype(np.float32)
    nothing = Beliefs.none(3, detector())
    every = nothing.traced(sequences, p)
    asked = sequences.sample + ahead
    found = every.ahead(p, asked, ahead // 2, hold)
    for j, (cell, sample) in enumerate(zip(sequences.cell.tolist(), sequences.sample.tolist(), strict=True)):
        so_far = (sequences.cell < cell) | (sequences.sample <= sample)
        known = nothing.filtered(sequences.select(so_far), p[so_far]).rows(np.array([cell]))
        for mine, expected in zip((every.signed[j], every.age[:, j]), (known.signed[0], known.age[:, 0]), strict=True):
            np.testing.assert_array_equal(mine, expected)
        standing = Standing(hold, sample + ahead - ahead // 2)
        assert found[j] == known.condition(p[[[j]]], asked[[j]], standing)[0, 0]


def test_what_is_held_stands() -> None:
    p = np.full((1, 4), 0.5, np.float32)
    now = after([1, 1, 1], detector())
    found = now.condition(p, np.array([2, 40, 52, 400]), Standing(50, 10**6))[0]
    assert found[0] == pytest.approx(found[2], abs=1e-3)
    assert found[3] < found[2]
    until_now = now.condition(p, np.array([2, 40, 52, 400]), Standing(50, 10))[0]
    assert until_now[1] < found[1], "the future is not held"


def test_what_has_lasted_is_kept_up_to_a_bound() -> None:
    assert after([1] * 100, detector()).age[1, 0] == pytest.approx(8 * 100, abs=40)
    sequences = Sequences.of(History.from_states(np.array([[1] + [2] * 20_000 + [1]], np.uint8)))
    never = Detector(Sensor(0.1, 0.1), Durations(np.zeros((2, 900))))
    found = Beliefs.none(1, never).filtered(sequences, np.full(2, 0.5, np.float32))
    assert found.age[1, 0] / 8 == MAX_AGE


def test_readings_that_the_model_does_not_know_are_left_out() -> None:
    found = after([1, 1], detector(), p=np.nan)
    assert found.state.tolist() == [UNOBSERVED]
    assert np.isnan(found.condition(np.full((1, 1), np.nan, np.float32), np.array([3]))).all()


def test_twenty_bytes_a_cell() -> None:
    assert Beliefs.none(1000, detector()).nbytes == 20 * 1000


def test_rows_are_taken_and_replaced() -> None:
    beliefs = Beliefs.none(2, detector())
    other = beliefs.replaced(np.array([1]), after([1], detector()))
    assert other.state.tolist() == [UNOBSERVED, 1]
    assert other.rows(np.array([1, 0, 1])).state.tolist() == [1, UNOBSERVED, 1]
    assert beliefs.state.tolist() == [UNOBSERVED, UNOBSERVED]


@pytest.mark.parametrize("wrong", [(0.5, 0.1), (0.1, 0.5), (-0.1, 0.1), (0.1, float("nan"))])
def test_what_is_no_sensor_is_refused(wrong: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="miss and false_alarm"):
        Sensor(*wrong)


@given(miss=RATE, false_alarm=RATE, p=st.floats(0, 1))
def test_a_reading_and_its_state(miss: float, false_alarm: float, p: float) -> None:
    sensor = Sensor(miss, false_alarm)
    assert float(sensor.state_probability(sensor.reading_probability(p))) == pytest.approx(p, abs=1e-6)


def test_a_detector_is_plain_json_and_back() -> None:
    before = Detector(Sensor(0.1, 0.02), MINUTE, 7, "so it was")
    after = Detector.from_dict(before.as_dict())
    assert (after.sensor, after.readings, after.reason) == (before.sensor, 7, "so it was")
    np.testing.assert_allclose(after.durations.log_kept, MINUTE.log_kept, atol=1e-6)
    for wrong in ({"miss": 0.7}, {"log_kept": [[0.0, 1.0]]}, {"log_kept": [[0.0, float("nan")]] * 2}):
        with pytest.raises(ValueError, match=r"miss|logarithms"):
            Detector.from_dict(before.as_dict() | wrong)

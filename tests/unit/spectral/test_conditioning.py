"""The state at a time, given the latest reading."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tidemap.history.history import NEVER, UNOBSERVED, History
from tidemap.history.timebase import TimeBase
from tidemap.spectral.conditioning import (
    MAX_KEPT,
    MIN_PROBABILITY,
    UNLEARNED,
    Evidence,
    Persistence,
    Standing,
    condition,
)
from tidemap.spectral.correction import NO_CORRECTION, LastingCorrection
from tidemap.spectral.estimators import fit
from tidemap.spectral.pairs import pairs_of
from tidemap.spectral.persistence import learn_lasting, learn_persistence
from tidemap.spectral.prediction import predict_times

SHARE = st.floats(0.001, 0.999)
MINUTES = TimeBase(0.0, 60.0)


def odds(p: float) -> float:
    return p / (1 - p)


@given(p=SHARE, q=SHARE, kept=st.floats(0, 0.999), state=st.sampled_from([0, 1]))
def test_it_is_the_formula_of_the_odds(p: float, q: float, kept: float, state: int) -> None:
    g = kept / ((1 - kept) * q)
    expected = odds(p) * (1 + g) if state else odds(p) / (1 + g)
    assert odds(float(condition(p, q, state, kept))) == pytest.approx(expected, rel=1e-6)


@given(p=SHARE, kept=st.floats(0, 0.999), state=st.sampled_from([0, 1]))
def test_without_a_rhythm_it_is_persistence(p: float, kept: float, state: int) -> None:
    q = p if state else 1 - p
    assert float(condition(p, q, state, kept)) == pytest.approx(kept * state + (1 - kept) * p, abs=1e-9)


@given(p=SHARE, q=SHARE, state=st.sampled_from([0, 1]))
def test_nothing_kept_is_the_model_and_more_kept_is_nearer_to_the_reading(p: float, q: float, state: int) -> None:
    found = condition(p, q, state, [0.0, 0.3, 0.9, 0.9999])
    assert found[0] == pytest.approx(p)
    distance = np.abs(found - state)
    assert np.all(np.diff(distance) <= 1e-12)


def test_a_surprising_reading_says_more_than_an_expected_one() -> None:
    assert condition(0.5, 0.05, 1, 0.5) > condition(0.5, 0.95, 1, 0.5)


@pytest.mark.parametrize("state", [0, 1])
def test_a_certain_model_can_be_wrong(state: int) -> None:
    found = float(condition(1.0 - state, 0.0, state, 0.9995))
    assert abs(found - state) < 0.2
    assert MIN_PROBABILITY < found < 1 - MIN_PROBABILITY


@given(delta=st.floats(0, 1e7), age=st.floats(0, 1e8), state=st.sampled_from([0, 1]))
def test_states_that_have_lasted_last_and_time_takes_its_toll(delta: float, age: float, state: int) -> None:
    kept = float(UNLEARNED.kept(state, delta, age))
    assert 0 < kept <= MAX_KEPT
    assert UNLEARNED.kept(state, delta + 60, age) <= kept <= UNLEARNED.kept(state, delta, age + 60)


@pytest.mark.parametrize("wrong", [{"nu": 0.0}, {"nu": 1.0}, {"tau_s": 0.0}, {"alpha": -1.0}, {"kappa": -0.1}])
def test_what_is_no_persistence_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="positive"):
        Persistence.from_dict(UNLEARNED.as_dict() | wrong)


@pytest.mark.parametrize(
    "table", [np.zeros((2, 2)), np.zeros((1, 2, 2)), np.zeros((2, 1, 2)), np.full((2, 2, 2), np.inf)]
)
def test_what_is_no_correction_is_refused(table: np.ndarray) -> None:
    with pytest.raises(ValueError, match="two states"):
        LastingCorrection(60.0, table)


def test_a_persistence_comes_back_from_what_is_stored_of_it() -> None:
    assert Persistence.from_dict(UNLEARNED.as_dict()).correction is NO_CORRECTION
    before = Persistence(0.9, 60.0, 1.5, 0.1, corrected())
    after = Persistence.from_dict(json.loads(json.dumps(before.as_dict())))
    assert after.as_dict() == before.as_dict()
    np.testing.assert_array_equal(after.correction.value, before.correction.value)


def corrected() -> LastingCorrection:
    return LastingCorrection(60.0, np.random.default_rng(2).normal(size=(2, 5, 3)))


def test_a_correction_is_linear_in_the_logarithms_and_constant_beyond() -> None:
    table = corrected()
    for i, j in ((0, 0), (4, 2), (2, 1)):
        assert table.at([0, 1], 60.0 * 2**i, 60.0 * 4**j) == pytest.approx(table.value[:, i, j])
    between = (table.value[1, 2, 1] + table.value[1, 3, 1] + table.value[1, 2, 2] + table.value[1, 3, 2]) / 4
    assert float(table.at(1, 60.0 * 2**2.5, 60.0 * 4**1.5)) == pytest.approx(between)
    assert table.at(0, [0.0, 1e9], [0.0, 1e9]) == pytest.approx(table.value[0, [0, 4], [0, 2]])


@pytest.mark.parametrize("persistence", [UNLEARNED, Persistence(0.8, 600.0, 1.2, 0.3, corrected())])
def test_evidence_of_several_cells_over_several_samples(persistence: Persistence) -> None:
    evidence = Evidence(
        np.array([1, 0, UNOBSERVED], np.uint8),
        np.array([10, 12, NEVER]),
        np.array([1, 10, 0], np.uint32),
        np.array([0.4, 0.7, 1.0], np.float32),
    )
    p = np.array([[0.5, 0.2, 0.9, 0.0]] * 3, np.float32)
    samples = np.array([5, 10, 12, 1000])
    for hold, limit, until in ((0, 0, (10, 12)), (50, 30, (30, 30)), (50, 11, (11, 12)), (5, 1000, (15, 17))):
        found = evidence.condition(p, samples, 60.0, persistence, Standing(hold, limit))
        assert found.dtype == np.float32
        np.testing.assert_array_equal(found[2], p[2])
        for cell, (state, age, q) in enumerate([(1, 1, 0.4), (0, 10, 0.7)]):
            read = int(evidence.sample[cell])
            for column, sample in enumerate(samples.tolist()):
                lived = 60.0 * (age + until[cell] - read)
                kept = persistence.kept(state, 60.0 * max(0, sample - until[cell]), lived)
                given_it = condition(p[cell, column], np.float32(q), state, kept)
                expected = p[cell, column] if sample < read else given_it
                assert found[cell, column] == pytest.approx(float(expected), abs=1e-6)


@given(data=st.data(), n=st.integers(1, 40))
def test_what_is_said_of_a_cell_does_not_depend_on_the_others(data: st.DataObject, n: int) -> None:
    def column(values: st.SearchStrategy[Any], dtype: str) -> np.ndarray:
        return np.array(data.draw(st.lists(values, min_size=n, max_size=n)), dtype)

    some = st.integers(-3, 3)
    evidence = Evidence(
        column(st.integers(0, 2), "u1"),
        column(st.one_of(some, st.integers(-(2**40), 2**40)), "i8"),
        column(st.one_of(some.map(abs), st.integers(0, 2**32 - 1)), "u4"),
        column(st.floats(0, 1), "f4"),
    )
    samples = np.array([0, 2**41])
    model = np.repeat(column(st.floats(0, 1), "f4")[:, np.newaxis], 2, axis=1)
    found = evidence.condition(model, samples, 60.0, UNLEARNED, Standing(5, 2))
    for cell in range(n):
        alone = evidence.part(slice(cell, cell + 1)).condition(model[[cell]], samples, 60.0, UNLEARNED, Standing(5, 2))
        np.testing.assert_array_equal(found[[cell]], alone)
    unread = evidence.without(np.arange(n)).condition(model, samples, 60.0, UNLEARNED)
    np.testing.assert_array_equal(unread, model)


def test_evidence_of_some_rows_is_taken_and_replaced() -> None:
    evidence = Evidence(
        np.array([1, 0], np.uint8), np.array([3, 4]), np.array([1, 2], np.uint32), np.array([0.25, 0.5], np.float32)
    )
    assert evidence.nbytes == 2 * 17
    other = evidence.replaced(np.array([0]), evidence.rows(np.array([1])))
    assert (other.state.tolist(), other.sample.tolist(), other.age.tolist()) == ([0, 0], [4, 4], [2, 2])
    assert evidence.state.tolist() == [1, 0]


def switching(n_samples: int, keep: float, seed: int) -> np.ndarray:
    """A state that is drawn anew, of either kind, in every sample with probability 1 - keep."""
    random = np.random.default_rng(seed)
    redrawn = random.random(n_samples) > keep
    redrawn[0] = True
    drawn = random.integers(0, 2, n_samples).astype(np.uint8)
    return drawn[np.maximum.accumulate(np.where(redrawn, np.arange(n_samples), 0))]


@pytest.mark.parametrize("keep", [0.5, 0.9, 0.99])
def test_how_long_states_last_is_learned(keep: float) -> None:
    history = History.from_states(switching(20_000, keep, 7)[np.newaxis])
    learned = learn_persistence(history, fit(history, "static", 0, MINUTES), MINUTES)
    for samples in (1, 5, 20):
        kept = learned.kept([0, 1], 60.0 * samples, 60.0 / (1 - keep))
        assert kept == pytest.approx(keep**samples, abs=0.06)


def test_stays_of_one_length_end_when_they_are_over() -> None:
    """The formula cannot say so, as what has lasted lasts by it; the correction does."""
    states = np.zeros(30_000, np.uint8)
    for first in np.flatnonzero(np.random.default_rng(4).random(states.size) < 0.01):
        states[first : first + 16] = 1
    history = History.from_states(states[np.newaxis])
    learned = learn_persistence(history, fit(history, "static", 0, MINUTES), MINUTES)
    young, old = learned.kept(1, 60.0, [60.0, 16 * 60.0])
    assert young > 0.95
    assert old < 0.85
    formula = replace(learned, correction=NO_CORRECTION)
    assert np.all(np.diff(formula.kept(1, 60.0, [60.0, 16 * 60.0])) >= 0)


def test_of_noise_hardly_anything_is_kept() -> None:
    states = np.random.default_rng(3).integers(0, 2, (4, 8000)).astype(np.uint8)
    history = History.from_states(states)
    learned = learn_persistence(history, fit(history, "static", 0, MINUTES), MINUTES)
    assert np.all(learned.kept([0, 1], 60.0, 60.0) < 0.05)


def test_with_nothing_to_learn_from_it_is_what_is_believed() -> None:
    for states in (
        np.zeros((0, 10), np.uint8),
        np.full((2, 10), UNOBSERVED, np.uint8),
        np.array([[2, 1, 2]], np.uint8),
    ):
        history = History.from_states(states)
        learned = learn_persistence(history, fit(history, "static", 0, MINUTES), MINUTES)
        assert learned.kept(1, 3600.0, 60.0) == pytest.approx(float(UNLEARNED.kept(1, 3600.0, 60.0)))


def test_pairs_are_readings_of_the_history() -> None:
    random = np.random.default_rng(5)
    states = random.integers(0, 3, (3, 500)).astype(np.uint8)
    states[1] = np.where(states[1] == 1, 0, states[1])
    history = History.from_states(states, start=40)
    spectrum = fit(history, "fft", 3, MINUTES)
    pairs = pairs_of(history, spectrum, MINUTES)
    assert pairs is not None
    assert pairs.state.size > 10_000
    assert (pairs.delta_s >= 60).all()
    assert (pairs.age_s >= 60).all()
    every = predict_times(spectrum, MINUTES.time(np.arange(40, 540)))
    assert np.isin(np.float32(np.where(pairs.state != 0, pairs.own, 1 - pairs.own)), every).all()


def test_pairs_stand_for_all_pairs() -> None:
    """Those before a change are chosen more often, and count less."""
    states = switching(3000, 0.97, 5)
    states[np.random.default_rng(1).random(3000) < 0.3] = UNOBSERVED
    history = History.from_states(states[np.newaxis])
    pairs = pairs_of(history, fit(history, "static", 0, MINUTES), MINUTES)
    assert pairs is not None
    runs = 1 + np.count_nonzero(np.diff(states[states != UNOBSERVED]))
    assert pairs.independent.sum() == pytest.approx(3 * runs, rel=0.1)
    near = pairs.delta_s == 60.0
    both = (states[1:] != UNOBSERVED) & (states[:-1] != UNOBSERVED)
    changed = np.mean(states[1:][both] != states[:-1][both])
    assert np.average(~pairs.same[near], weights=pairs.evidence[near]) == pytest.approx(changed, rel=0.25)
    assert np.mean(~pairs.same[near]) > 3 * changed


def test_the_slope_of_the_loss_is_its_derivative() -> None:
    history = History.from_states(switching(2000, 0.9, 8)[np.newaxis])
    pairs = pairs_of(history, fit(history, "static", 0, MINUTES), MINUTES)
    assert pairs is not None
    for log_lasted in (-2.0, 0.0, 3.0):
        low, high = (pairs.losses(np.exp(np.full(len(pairs.q), log_lasted + step)))[0] for step in (-1e-4, 1e-4))
        _, slope = pairs.losses(np.exp(np.full(len(pairs.q), log_lasted)))
        np.testing.assert_allclose((high - low) / 2e-4, slope, atol=1e-6)


@pytest.mark.parametrize("spread", [0.0, 1.0])
def test_cells_differ_where_they_do(spread: float) -> None:
    last_s = 1800.0 * np.exp(spread * np.linspace(-1.5, 1.5, 12))
    states = [switching(10_000, float(np.exp(-60.0 / each)), seed) for seed, each in enumerate(last_s)]
    history = History.from_states(np.array(states))
    learned = learn_lasting(history, fit(history, "static", 0, MINUTES), MINUTES)
    if spread:
        assert np.corrcoef(learned.offset, np.log(last_s))[0, 1] > 0.85
        assert learned.offset[-1] - learned.offset[0] > 1.2
    else:
        assert np.abs(learned.offset).max() < 0.1


def test_a_cell_of_few_runs_does_not_differ() -> None:
    states = np.array([switching(6000, keep, 11) for keep in (0.9, 0.95, 0.98, 0.99)])
    states[3, 30:] = UNOBSERVED
    history = History.from_states(states)
    learned = learn_lasting(history, fit(history, "static", 0, MINUTES), MINUTES)
    assert abs(learned.offset[3]) < 0.5 < np.abs(learned.offset[:3]).max()
    one = learn_lasting(history.cells([0]), fit(history.cells([0]), "static", 0, MINUTES), MINUTES)
    assert one.offset.tolist() == [0.0]


@pytest.mark.parametrize("seed", range(3))
def test_what_is_given_predicts_better_than_rhythm_and_than_persistence(seed: int) -> None:
    """Open by day more often than by night, and for as long as it lasts."""
    random, n = np.random.default_rng(seed), 28 * 144
    base = TimeBase(0.0, 600.0)
    day = (np.arange(n) % 144 >= 48) & (np.arange(n) % 144 < 108)
    p = np.where(day, 0.8, 0.1)
    redrawn = random.random(n) > 0.85
    redrawn[0] = True
    drawn = (random.random(n) < p).astype(np.uint8)
    states = drawn[np.maximum.accumulate(np.where(redrawn, np.arange(n), 0))]
    past, border = History.from_states(states[np.newaxis, : 21 * 144]), 21 * 144
    spectrum = fit(past, "calendar", 16, base)
    learned = learn_persistence(past, spectrum, base)
    model = predict_times(spectrum, base.time(np.arange(n)))[0].astype(np.float64)
    mean = states[:border].mean()
    for ahead in (1, 3, 12):
        at = np.arange(border, n - ahead)
        run = np.array([k - np.flatnonzero(np.diff(states[: k + 1], prepend=9))[-1] for k in at])
        truth, last = states[at + ahead], states[at]
        q = np.where(last == 1, model[at], 1 - model[at])
        kept = learned.kept(last, 600.0 * ahead, 600.0 * (run + 1))
        loss = [
            _log_loss(each, truth)
            for each in (
                condition(model[at + ahead], q, last, kept),
                model[at + ahead],
                0.85**ahead * last + (1 - 0.85**ahead) * mean,
            )
        ]
        assert loss[0] < min(loss[1:])


def _log_loss(p: np.ndarray, truth: np.ndarray) -> float:
    bounded = np.clip(p, 1e-4, 1 - 1e-4)
    return float(-np.log(np.where(truth == 1, bounded, 1 - bounded)).mean())

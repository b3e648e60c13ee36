"""The four operations on cases that can be read."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from tidemap.history.history import UNOBSERVED, History
from tidemap.history.timebase import TimeBase
from tidemap.spectral.model import SpectralModel, accuracy, add, fit_part, predict, reconstruct, update
from tidemap.spectral.outliers import Outliers, count, count_outliers, find_outliers
from tidemap.spectral.recipe import Recipe

BASE = TimeBase(0.0, 60.0)


def static_model(states: list[int], start: int = 0) -> SpectralModel:
    return update(History.from_states(np.array([states], np.uint8), start), "static", 0, BASE)


def test_outliers_are_split_by_what_was_not_observed() -> None:
    outliers = static_model([0, 0, 0, 0, 1, 1, 2, 1, 0], start=-3).outliers
    assert outliers.of(0).tolist() == [[1, 3], [4, 5]]
    assert count(outliers).tolist() == [3]


def test_outliers_to_the_last_bit_of_the_last_word() -> None:
    states = np.zeros((2, 128), np.uint8)
    states[0, 63:65] = 1
    states[1, 127] = 1
    outliers = update(History.from_states(states), "static", 0, BASE).outliers
    assert outliers.of(0).tolist() == [[63, 65]]
    assert outliers.of(1).tolist() == [[127, 128]]


def test_counting_the_outliers_of_noise_takes_hardly_more_than_one_of_its_planes() -> None:
    states = np.random.default_rng(0).integers(0, 3, (64, 1 << 14)).astype(np.uint8)
    history = History.from_states(states)
    model = update(history, "static", 0, BASE)
    # Compiling what counts would be counted as well.
    count_outliers(model.spectrum, history, BASE)
    tracemalloc.start()
    try:
        found = count_outliers(model.spectrum, history, BASE)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert found.tolist() == count(model.outliers).tolist()
    assert peak < 2 * history.observed.nbytes
    assert model.outliers.start.nbytes > 4 * peak


def test_accuracy_is_one_minus_wrong_over_observed() -> None:
    assert accuracy(static_model([0, 0, 1, 2, 2])) == pytest.approx(2 / 3)
    assert np.isnan(accuracy(static_model([2, 2])))


@pytest.mark.parametrize("sample", [-70, -1, 0, 3, 4, 5, 8, 300])
@pytest.mark.parametrize("state", [0, 1])
def test_an_added_measurement_is_what_reconstruction_says(sample: int, state: int) -> None:
    before = static_model([0, 0, 0, 0, 1, 1, 2, 1, 0])
    after = add(before, sample, state)
    expected = History.from_states(reconstruct(before)).overlay(
        History.from_measurements(1, sample, sample + 1, [0], [sample], [state])
    )
    assert (after.start, after.stop) == (expected.start, expected.stop)
    np.testing.assert_array_equal(reconstruct(after), expected.states())
    runs = after.outliers.of(0)
    assert np.all(runs[1:, 0] > runs[:-1, 1]), "ascending, never touching"


def test_adding_leaves_other_cells_alone() -> None:
    states = np.random.default_rng(0).integers(0, 2, (5, 90)).astype(np.uint8)
    model = update(History.from_states(states), "fft", 2, BASE)
    states[3, 17] ^= 1
    np.testing.assert_array_equal(reconstruct(add(model, 17, int(states[3, 17]), cell=3)), states)


def test_wrong_arguments_are_refused() -> None:
    model = static_model([0, 1])
    with pytest.raises(ValueError, match="0 or 1"):
        add(model, 0, 2)
    with pytest.raises(IndexError):
        add(model, 0, 1, cell=1)
    with pytest.raises(ValueError, match="a spectrum of 1"):
        find_outliers(model.spectrum, History.empty(2), BASE)
    with pytest.raises(IndexError):
        Outliers.empty(1).of(1)


def test_a_fit_window_leaves_the_outliers_of_the_whole_history() -> None:
    states = np.random.default_rng(1).integers(0, 3, (4, 400)).astype(np.uint8)
    history = History.from_states(states, start=-10)
    model = update(history, "fft", 5, BASE, fit_window=(100, 300))
    assert model.spectrum.origin_s == 6000.0
    np.testing.assert_array_equal(reconstruct(model), states)
    np.testing.assert_array_equal(reconstruct(model, -50, 60), history.window(-50, 60).states())


def test_a_model_over_read_only_planes() -> None:
    history = History.from_states(np.array([[0, 1, 1, 0, 2]], np.uint8))
    history.observed.flags.writeable = history.occupied.flags.writeable = False
    model = update(history, "fft", 1, BASE)
    np.testing.assert_array_equal(reconstruct(replace(model)), history.states())


@pytest.mark.parametrize("estimator", ["static", "fft", "calendar"])
def test_cells_seen_before_the_window_keep_their_mean(estimator: str) -> None:
    states = np.full((3, 200), UNOBSERVED, np.uint8)
    states[0, :4] = (1, 1, 1, 0)
    states[1, 100:] = np.tile((0, 1), 50)
    history = History.from_states(states)
    spectrum = fit_part(history, Recipe(estimator, 2), TimeBase(0.0, 900.0), (100, 200))
    found = predict(spectrum, 0.0)
    assert found[0] == pytest.approx(0.75, abs=0.06)
    assert np.isnan(found[2])

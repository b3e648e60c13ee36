"""What must hold of `calendar` for any history."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tidemap.history.history import UNOBSERVED, History
from tidemap.history.timebase import TimeBase
from tidemap.spectral.estimators import fit_recipe
from tidemap.spectral.model import reconstruct, refit
from tidemap.spectral.prediction import predict_slow, predict_times
from tidemap.spectral.recipe import Prior, Recipe
from tidemap.spectral.reconstruction import predicted_words

BASE = TimeBase(1.7e9, 3600.0)
WEEK = 168
STATES = hnp.arrays(
    np.uint8, st.tuples(st.integers(1, 4), st.integers(1, 400)), elements=st.integers(0, 2), fill=st.integers(0, 2)
)
HISTORIES = st.builds(History.from_states, STATES, start=st.integers(-(10**5), 10**5))
PRIORS = st.builds(
    Prior,
    week=st.sampled_from(["day", "weekend", "week", "days"]),
    detail=st.sampled_from(["smooth", "sharp"]),
    evidence=st.sampled_from([0.05, 0.25, 4.0]),
    half_life_days=st.sampled_from([3.0, 28.0, float("inf")]),
)
RECIPES = st.builds(
    Recipe,
    estimator=st.just("calendar"),
    order=st.integers(0, 80),
    time_zone=st.sampled_from(["UTC", "Europe/Amsterdam", "Asia/Kathmandu", "America/St_Johns"]),
    priors=st.lists(PRIORS, min_size=1, max_size=2).map(tuple),
    period_s=st.sampled_from([None, 36 * 3600.0]),
    carry_over=st.sampled_from([0.0, 0.5, 1.0]),
    level_sd=st.sampled_from([0.0, 0.6]),
)
quick = settings(max_examples=40, deadline=None)


@quick
@given(HISTORIES, RECIPES)
def test_reconstruction_is_lossless(history: History, recipe: Recipe) -> None:
    np.testing.assert_array_equal(reconstruct(refit(history, recipe, BASE)), history.states())


@quick
@given(HISTORIES, RECIPES, st.integers(-300, 600), st.integers(0, 300))
def test_words_are_the_thresholded_sum_in_every_span(history: History, recipe: Recipe, first: int, n: int) -> None:
    spectrum = fit_recipe(history, recipe, BASE)
    start = history.start + first
    words = predicted_words(spectrum, BASE, start, start + n)
    bits = np.unpackbits(words.view(np.uint8), axis=1, bitorder="little")
    truth = predict_slow(spectrum, BASE.time(64 * (start // 64) + np.arange(bits.shape[1])))
    clear = np.abs(truth - 0.5) > 1e-4
    np.testing.assert_array_equal(bits[clear], (truth > 0.5)[clear])


@quick
@given(HISTORIES, RECIPES, st.integers(0, 400))
def test_unobserved_samples_may_be_left_out(history: History, recipe: Recipe, more: int) -> None:
    """A window that reaches back over samples nobody saw tells the same."""
    wider = history.window(history.start - more, history.stop)
    one, other = (fit_recipe(each, recipe, BASE) for each in (history, wider))
    np.testing.assert_allclose(one.mean, other.mean, atol=1e-3)
    time = BASE.time(history.start + np.arange(0, 400, 13))
    np.testing.assert_allclose(predict_times(one, time), predict_times(other, time), atol=2e-3)


@quick
@given(HISTORIES, RECIPES, st.integers(-20, 20))
def test_whole_weeks_change_nothing(history: History, recipe: Recipe, weeks: int) -> None:
    later = History(history.start + weeks * WEEK, history.n_samples, history.observed, history.occupied)
    recipe = replace(recipe, order=12, time_zone="UTC", period_s=None)
    one, other = (fit_recipe(each, recipe, BASE) for each in (history, later))
    np.testing.assert_array_equal(one.mean, other.mean)
    np.testing.assert_array_equal(one.coefficient, other.coefficient)


@quick
@given(HISTORIES, RECIPES)
def test_free_and_occupied_are_mirror_images(history: History, recipe: Recipe) -> None:
    states = history.states()
    mirrored = History.from_states(np.where(states == UNOBSERVED, states, 1 - states), history.start)
    time = BASE.time(history.start + np.arange(0, 400, 13))
    one, other = (predict_times(fit_recipe(each, recipe, BASE), time) for each in (history, mirrored))
    np.testing.assert_allclose(one, 1 - other, atol=5e-3)


@quick
@given(STATES, st.data())
def test_cells_do_not_depend_on_their_neighbours(states: np.ndarray, data: st.DataObject) -> None:
    history, recipe = History.from_states(states), data.draw(RECIPES)
    chosen = data.draw(st.integers(0, history.n_cells - 1))
    time = BASE.time(np.arange(0, 400, 13))
    alone = predict_times(fit_recipe(history.cells([chosen]), recipe, BASE), time)
    np.testing.assert_array_equal(alone, predict_times(fit_recipe(history, recipe, BASE), time, [chosen]))

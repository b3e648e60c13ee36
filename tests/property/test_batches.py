"""A cell's results are the same to the bit in whatever batch, block and thread it is computed."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tidemap.history.history import History
from tidemap.history.timebase import TimeBase
from tidemap.spectral import prediction, transform
from tidemap.spectral.auto.blending import blend
from tidemap.spectral.auto.selection import choose
from tidemap.spectral.auto.trials import task
from tidemap.spectral.calendar import estimator, logistic
from tidemap.spectral.calendar.products import pack, product
from tidemap.spectral.estimators import ESTIMATORS, fit_recipe
from tidemap.spectral.model import refit
from tidemap.spectral.prediction import predict, predict_times
from tidemap.spectral.recipe import Prior, Recipe
from tidemap.spectral.spectrum import Spectrum, concatenate, select

ZONE = "Europe/London"
N_CELLS, DAY = 150, 288
BASE = TimeBase(1_711_324_800.0, 300.0)
AHEAD = BASE.time(np.arange(-50, 6 * DAY, 61))
RECIPES = [
    *(Recipe(name, 9, ZONE) for name in sorted(ESTIMATORS)),
    Recipe("calendar", 5, ZONE, carry_over=0.5, level_sd=0.4),
    Recipe("calendar", 200, ZONE, (Prior("week", "smooth", 0.25, 7.0),), period_s=129_600.0),
    Recipe("calendar", 16, ZONE, tuple(Prior(evidence=4.0**-i) for i in range(6))),
]


def some_history() -> History:
    """Random, constant and hardly observed cells; those that are observed at every second sample alone are hard."""
    states = np.random.default_rng(5).integers(0, 3, (N_CELLS, 4 * DAY)).astype(np.uint8)
    states[:, ::2] = states[:, :1]
    states[7], states[8], states[9, 5:] = 0, 2, 2
    return History.from_states(states)


HISTORY = some_history()
WHOLE = {recipe: fit_recipe(HISTORY, recipe, BASE) for recipe in RECIPES}


def same(one: Spectrum, other: Spectrum) -> None:
    """The same cells, whichever waves each keeps in its table."""
    np.testing.assert_array_equal(one.mean, other.mean)
    np.testing.assert_array_equal(one.cell, other.cell)
    np.testing.assert_array_equal(one.coefficient, other.coefficient)
    used = one.coefficient != 0
    for name in ("frequency_hz", "gate"):
        ours, theirs = (getattr(each, name)[each.index[used]] for each in (one, other))
        np.testing.assert_array_equal(ours, theirs)


batches = st.lists(st.integers(1, N_CELLS - 1), max_size=5, unique=True).map(sorted)
orders = st.randoms(use_true_random=False).map(lambda chance: np.array(chance.sample(range(N_CELLS), N_CELLS)))


@pytest.mark.parametrize("recipe", RECIPES, ids=lambda recipe: f"{recipe.estimator}-{recipe.order}")
@settings(max_examples=8, deadline=None)
@given(order=orders, cuts=batches, block=st.sampled_from([1, 3, 5, 64, 77]), threads=st.sampled_from([1, 3]))
def test_a_batch_does_not_change_a_cell(
    recipe: Recipe, order: NDArray[np.int64], cuts: list[int], block: int, threads: int
) -> None:
    with blocks_of(block), ThreadPoolExecutor(threads) as pool:
        parts = [HISTORY.cells(cells) for cells in np.split(order, cuts)]
        joined = concatenate(list(pool.map(lambda part: fit_recipe(part, recipe, BASE), parts)))
    same(select(WHOLE[recipe], order), joined)


@contextmanager
def blocks_of(rows: int) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        for module, name in ((estimator, "BLOCK"), (logistic, "ROWS"), (transform, "BATCH_ROWS")):
            patch.setattr(module, name, rows)
        yield


@pytest.mark.parametrize("recipe", RECIPES, ids=lambda recipe: f"{recipe.estimator}-{recipe.order}")
@settings(max_examples=8, deadline=None)
@given(order=orders, n=st.integers(1, N_CELLS), threads=st.sampled_from([1, 2, 5]))
def test_a_batch_does_not_change_a_probability(recipe: Recipe, order: NDArray[np.int64], n: int, threads: int) -> None:
    spectrum, cells = WHOLE[recipe], order[:n]
    for time in AHEAD[:: len(AHEAD) // 4]:
        whole = predict(spectrum, time)
        np.testing.assert_array_equal(predict(spectrum, time, cells), whole[cells])
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(prediction, "WORTHWHILE", 1)
            np.testing.assert_array_equal(predict(spectrum, time, threads=threads), whole)
    whole = predict_times(spectrum, AHEAD)
    np.testing.assert_array_equal(predict_times(spectrum, AHEAD, cells), whole[cells])
    np.testing.assert_array_equal(predict_times(spectrum, AHEAD[: n + 1], cells), whole[cells][:, : n + 1])


@pytest.mark.parametrize("recipe", RECIPES, ids=lambda recipe: f"{recipe.estimator}-{recipe.order}")
def test_a_batch_does_not_change_an_outlier(recipe: Recipe) -> None:
    whole = refit(HISTORY, recipe, BASE).outliers
    for cells in ([0], [149, 3, 7], range(1, 70)):
        part = refit(HISTORY.cells(list(cells)), recipe, BASE).outliers
        for at, cell in enumerate(cells):
            np.testing.assert_array_equal(part.of(at), whole.of(cell))


@settings(max_examples=4, deadline=None)
@given(block=st.sampled_from([1, 3, 5, 77]), threads=st.sampled_from([1, 3]))
def test_neither_blocks_nor_threads_change_a_choice(block: int, threads: int) -> None:
    random = np.random.default_rng(1).random((12, 9 * DAY))
    states = (np.sin(np.arange(9 * DAY) * 2 * np.pi / DAY) > 1.6 * random - 0.8).astype(np.uint8)
    history = History.from_states(states)
    expected = choose(history, BASE, time_zone=ZONE)
    assert expected.estimator == "calendar"
    with blocks_of(block), ThreadPoolExecutor(threads) as pool:
        found = list(pool.map(lambda _: choose(history, BASE, time_zone=ZONE), range(threads)))
    assert found == [expected] * threads


@settings(max_examples=4, deadline=None)
@given(block=st.sampled_from([1, 3, 5, 77]))
def test_blocks_change_no_coefficient_of_a_blend(block: int) -> None:
    work = task(HISTORY.cells(range(3)), BASE, ZONE, 4)
    expected = blend(work)
    with blocks_of(block):
        found = blend(work)
    np.testing.assert_array_equal(found.beta, expected.beta)
    np.testing.assert_array_equal(found.probability(16), expected.probability(16))
    assert (found.priors, found.carry_over, found.loss) == (expected.priors, expected.carry_over, expected.loss)


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 70), st.integers(1, 200), st.integers(1, 150), st.integers(0, 2**32 - 1))
def test_a_row_of_a_product_depends_on_nothing_but_the_row(n: int, inner: int, columns: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    rows, matrix = (random.standard_normal(shape).astype(np.float32) for shape in ((n, inner), (inner, columns)))
    panels, order = pack(matrix), random.permutation(n)
    whole = product(rows, panels)
    np.testing.assert_array_equal(product(rows[order], panels), whole[order])
    for row in range(0, n, 7):
        np.testing.assert_array_equal(product(rows[row : row + 1], panels)[0], whole[row])
    truth = rows.astype(np.float64) @ matrix.astype(np.float64)
    size = np.abs(rows).astype(np.float64) @ np.abs(matrix).astype(np.float64)
    assert np.all(np.abs(whole - truth) <= inner * np.finfo(np.float32).eps * size)

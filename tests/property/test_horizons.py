"""Walks: every reading is predicted from what was read long enough before it, by what was learned from its past."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tidemap.errors import AskerLeftError
from tidemap.history.history import UNOBSERVED, History
from tidemap.history.timebase import TimeBase
from tidemap.spectral.conditioning import condition
from tidemap.spectral.evaluation import ScoreSums
from tidemap.spectral.horizons import Learned, WalkPlan, learn, walk
from tidemap.spectral.prediction import predict_times
from tidemap.spectral.recipe import Recipe
from tidemap.spectral.switching import Switching, learn_switching

BASE = TimeBase(1000.0, 60.0)
STATIC = Recipe("static", 0)


@pytest.fixture(autouse=True, scope="module")
def few_pairs() -> Iterator[None]:
    """Learned from few pairs: it is what is learned from that matters here, not how well."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tidemap.spectral.pairs.MAX_PAIRS", 200)
        yield


def slowly(states: np.ndarray, plan: WalkPlan, recipe: Recipe) -> list[list[ScoreSums]]:
    """Conditioned, rhythm and persistence of every horizon, reading by reading."""
    sums = [[ScoreSums(), ScoreSums(), ScoreSums()] for _ in plan.horizons]
    for cut in range(plan.start, states.shape[1], plan.step):
        learned = learn(History.from_states(states[:, :cut]), BASE, recipe)
        for mine, horizon in zip(sums, plan.horizons, strict=True):
            for cell, row in enumerate(states):
                for n in range(cut, min(cut + plan.step, len(row))):
                    add_reading(mine, row[: max(0, n - horizon + 1)], (cell, n, int(row[n])), learned)
    return sums


def add_reading(sums: list[ScoreSums], before: np.ndarray, reading: tuple[int, int, int], learned: Learned) -> None:
    """Add one reading, a cell in a sample in a state, predicted from what was read of its cell before."""
    cell, n, truth = reading
    known = np.flatnonzero(before != UNOBSERVED).tolist()
    if truth == UNOBSERVED or not known:
        return
    last = known[-1]
    run = next((k for k in reversed(known) if before[k] != before[last]), -1)
    begin = next(k for k in known if k > run)
    p, at_last = predict_times(learned.spectrum, BASE.time([n, last]), [cell])[0].astype(float)
    kept = learned.persistence.kept(before[last], 60.0 * (n - last), 60.0 * (last - begin + 1))
    q = at_last if before[last] else 1 - at_last
    answers = (condition(p, q, before[last], kept), p, learned.switching[cell].expect(before[last], n - last))
    for each, answer in zip(sums, answers, strict=True):
        each.add(answer, truth)


ROWS = st.lists(st.sampled_from([0, 0, 0, 1, 1, UNOBSERVED]), min_size=60, max_size=60)


@settings(max_examples=8, deadline=None)
@given(
    rows=st.lists(ROWS, min_size=1, max_size=2),
    horizons=st.lists(st.integers(1, 40), min_size=1, max_size=3),
    recipe=st.sampled_from([STATIC, Recipe("fft", 2)]),
)
def test_a_walk_is_reading_by_reading_what_was_known(
    rows: list[list[int]], horizons: list[int], recipe: Recipe
) -> None:
    states = np.array(rows, np.uint8)
    plan = WalkPlan(start=30, step=16, horizons=tuple(horizons))
    found = walk(History.from_states(states), BASE, plan, lambda _: recipe)
    for each, slow in zip(found, slowly(states, plan, recipe), strict=True):
        for mine, expected in zip((each.conditioned, each.rhythm, each.persistence), slow, strict=True):
            assert mine.n == expected.n
            if mine.n:
                np.testing.assert_allclose(values(mine), values(expected), rtol=1e-5)


def values(sums: ScoreSums) -> list[float]:
    scores = sums.scores()
    return [scores.error, scores.brier, scores.log_loss]


def test_what_predicts_is_learned_from_the_past_alone() -> None:
    history = History.from_states((np.arange(200) // 7 % 2).astype(np.uint8)[np.newaxis])
    pasts: list[Any] = []

    def choose(past: History) -> Recipe:
        pasts.append((past.start, past.stop))
        return STATIC

    walk(history, BASE, WalkPlan(100, 40, (1,)), choose)
    assert pasts == [(0, 100), (0, 140), (0, 180)]


def test_a_walk_ends_with_its_asker() -> None:
    history = History.from_states((np.arange(200) // 7 % 2).astype(np.uint8)[np.newaxis])

    def leave() -> None:
        raise AskerLeftError

    with pytest.raises(AskerLeftError):
        walk(history, BASE, WalkPlan(100, 40, (1,)), lambda _: STATIC, leave)


@pytest.mark.parametrize(("up", "down"), [(0.1, 0.02), (0.3, 0.3), (0.001, 0.01)])
def test_the_rate_is_that_of_the_chain(up: float, down: float) -> None:
    random, state = np.random.default_rng(3), [0]
    for chance in random.random(200_000).tolist():
        state.append(int(chance < up) if state[-1] == 0 else int(chance >= down))
    states = np.array(state, np.uint8)
    for sample in (np.arange(len(states)), np.flatnonzero(random.random(len(states)) < 0.3)):
        found = learn_switching(sample, states[sample])
        assert found.mean == pytest.approx(up / (up + down), abs=0.03)
        assert np.exp(-found.rate) == pytest.approx(1 - up - down, abs=0.02)


def test_little_is_no_certainty() -> None:
    for sample, state in (([3], [1]), ([3, 9], [0, 0]), ([0, 1, 5], [1, 1, 1])):
        found = learn_switching(np.array(sample), np.array(state, np.uint8))
        assert 0 < found.mean < 1
        assert 0 < float(found.expect(0, 5)) < 1
    assert Switching(0.5, 0.1).expect([1, 0], [0, 0]).tolist() == [1, 0]

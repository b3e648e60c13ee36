"""Evaluation: the figures are those that pencil and paper give."""

import math
from typing import Any

import numpy as np
import pytest

from tests.support.contexts import make_location, post_rows, post_states, refit
from tests.support.truth import share
from tidemap.errors import InvalidInputError, NoModelError
from tidemap.services.context import Context
from tidemap.services.evaluate import Comparison, EvaluateQuery, evaluate
from tidemap.services.predict import PredictQuery, predict_at

MINUTE = 60.0


def ask(ctx: Context, name: str = "door", **form: Any) -> Comparison:
    return evaluate(ctx, name, EvaluateQuery(**{"orders": [0], "estimators": ["static"], **form}))


def make_door(ctx: Context) -> None:
    """Three of four minutes open, for a hundred minutes; then five minutes nobody knew of: 1 1 0 - 1."""
    make_location(ctx, "door")
    post_states(ctx, "door", MINUTE * np.arange(100), np.arange(100) % 4 != 0)
    refit(ctx, "door", estimator="static")
    post_states(ctx, "door", MINUTE * np.array([100, 101, 102, 104]), [1, 1, 0, 1])


def test_the_mean_is_scored_as_by_hand(ctx: Context) -> None:
    make_door(ctx)
    (row,) = ask(ctx, start=MINUTE * 100, stop=MINUTE * 105).candidates
    assert (row.estimator, row.order, row.scores.n) == ("static", 0, 4)
    assert row.scores.error == 0.25
    p = share(75, 100)
    assert row.scores.brier == pytest.approx((3 * (1 - p) ** 2 + p**2) / 4)
    assert row.scores.log_loss == pytest.approx(-(3 * math.log(p) + math.log(1 - p)) / 4)


def test_the_reliability_of_the_best_is_what_happened(ctx: Context) -> None:
    make_door(ctx)
    answer = ask(ctx, start=MINUTE * 100, stop=MINUTE * 105)
    assert answer.reliability is not None
    assert answer.best is not None
    table, filled = answer.reliability, answer.reliability.count > 0
    assert table.count[filled].tolist() == [4]
    assert table.observed_rate[filled].tolist() == [0.75]
    assert table.probability_mean[filled].tolist() == pytest.approx([share(75, 100)])
    assert (answer.best.estimator, answer.best.order, answer.revision) == ("static", 0, 1)


def test_a_confidence_is_the_threshold_of_the_error(ctx: Context) -> None:
    make_door(ctx)
    (row,) = ask(ctx, start=MINUTE * 100, stop=MINUTE * 105, confidence=0.8).candidates
    assert row.scores.error == 0.75


def test_measurements_given_are_scored_instead_of_the_history(ctx: Context) -> None:
    make_door(ctx)
    (row,) = ask(ctx, time=[1e6, 1e6 + 0.5, 1e7], state=[0, 0, 1]).candidates
    assert row.scores.n == 3
    assert row.scores.error == pytest.approx(2 / 3)
    (row,) = ask(ctx, time=[1e6, 1e6 + 0.5, 1e7], state=[0, 0, 1], start=1e6 + 0.5, stop=1e7).candidates
    assert (row.scores.n, row.scores.error) == (1, 1.0)


def test_the_spectra_are_fitted_on_the_training_window_alone(ctx: Context) -> None:
    make_door(ctx)
    (row,) = ask(ctx, start=MINUTE * 100, stop=MINUTE * 105, train_start=0.0, train_stop=MINUTE).candidates
    assert (row.scores.error, row.scores.n) == (0.75, 4)
    assert row.scores.brier == pytest.approx((3 * share(1, 1) ** 2 + share(0, 1) ** 2) / 4)


def test_every_order_is_scored_by_its_own_prediction(ctx: Context) -> None:
    make_location(ctx, "door")
    time = MINUTE * np.arange(240)
    state = (np.sin(time / MINUTE / 40 * 2 * np.pi) > 0.3) ^ (np.arange(240) % 17 == 0)
    post_states(ctx, "door", time, state)
    refit(ctx, "door", estimator="fft", order=2, stop=MINUTE * 160)
    orders = [0, 1, 2, 5]
    answer = ask(ctx, orders=[*orders, 2], estimators=["fft", "static", "fft"], start=MINUTE * 160, stop=MINUTE * 240)
    assert [(row.estimator, row.order) for row in answer.candidates] == [*(("fft", n) for n in orders), ("static", 0)]
    for row in answer.candidates[:-1]:
        p = predict_at(ctx, "door", PredictQuery(time[160:].tolist(), order=row.order)).probability[0].astype(float)
        s = state[160:].astype(float)
        q = np.clip(p, 1e-3, 1 - 1e-3)
        assert row.scores.n == 80
        assert row.scores.error == pytest.approx(np.mean((p > 0.5) != s), abs=1e-6)
        assert row.scores.brier == pytest.approx(np.mean((p - s) ** 2), abs=1e-6)
        assert row.scores.log_loss == pytest.approx(-np.mean(s * np.log(q) + (1 - s) * np.log(1 - q)), abs=1e-6)
    best = min(answer.candidates, key=lambda row: row.scores.log_loss)
    assert answer.best is not None
    assert (answer.best.estimator, answer.best.order) == (best.estimator, best.order)
    zero, mean = answer.candidates[0], answer.candidates[-1]
    assert zero.scores == mean.scores


def test_a_grid_is_scored_over_all_its_cells(ctx: Context) -> None:
    make_location(ctx, "lab", (40, 40))
    cells = {3: [1, 1, 1, 0], 1200: [0, 0, 0, 0]}
    post_rows(
        ctx, "lab", [(MINUTE * n, cell, state) for cell, states in cells.items() for n, state in enumerate(states)]
    )
    post_rows(ctx, "lab", [(0.0, 900, 1)])
    refit(ctx, "lab", estimator="static")
    (row,) = ask(ctx, "lab", start=0.0, stop=MINUTE * 4).candidates
    assert row.scores.n == 9
    assert row.scores.error == pytest.approx(1 / 9)
    p, free, full = share(3, 4), share(0, 4), share(1, 1)
    squares = 3 * (1 - p) ** 2 + p**2 + 4 * free**2 + (1 - full) ** 2
    assert row.scores.brier == pytest.approx(squares / 9)


def test_a_large_evaluation_scores_cells_spread_evenly(ctx: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tidemap.services.evaluate.MAX_VALUES", 1600)
    make_location(ctx, "lab", (40, 40))
    post_rows(ctx, "lab", [(MINUTE * n, cell, cell % 2) for n in range(4) for cell in range(1600)])
    refit(ctx, "lab", estimator="static")
    (row,) = ask(ctx, "lab").candidates
    assert row.scores.error == 0.0
    assert 1200 <= row.scores.n <= 2400
    monkeypatch.setattr("tidemap.services.evaluate.MAX_VALUES", 1)
    (row,) = ask(ctx, "lab").candidates
    assert row.scores.n >= 4


@pytest.mark.parametrize(
    ("form", "field"),
    [
        ({"orders": [0, 65]}, "orders[1]"),
        ({"orders": [-1]}, "orders[0]"),
        ({"start": MINUTE * 900, "stop": MINUTE * 901}, "stop"),
        ({"start": MINUTE * 103, "stop": MINUTE * 104}, "start"),
        ({"start": 60.0, "stop": 0.0}, "stop"),
        ({"train_start": MINUTE * 900}, "train_stop"),
        ({"time": [1.0], "state": [1, 0]}, "state"),
        ({"time": [1.0]}, "state"),
        ({"state": [1]}, "state"),
        ({"time": [], "state": []}, "start"),
    ],
)
def test_what_cannot_be_scored_is_refused_by_name(ctx: Context, form: dict[str, Any], field: str) -> None:
    make_door(ctx)
    with pytest.raises(InvalidInputError) as caught:
        ask(ctx, **form)
    assert caught.value.errors[0].field == field


def test_grids_are_scored_by_their_history_only_and_nothing_without_a_model(ctx: Context) -> None:
    make_location(ctx, "lab", (4, 4))
    with pytest.raises(NoModelError):
        ask(ctx, "lab")
    post_rows(ctx, "lab", [(0.0, 3, 1)])
    refit(ctx, "lab", estimator="static")
    with pytest.raises(InvalidInputError, match="kind 'state' only"):
        ask(ctx, "lab", time=[1.0], state=[1])

"""Scores by horizon of stored locations: those of the answers that `predict` gives as of that time before."""

from typing import Any

import numpy as np
import pytest

from tests.support.contexts import NOW, Clock, make_location, post_rows, post_states, refit
from tidemap.errors import InvalidInputError
from tidemap.services.context import Context
from tidemap.services.evaluate import EvaluateQuery, evaluate
from tidemap.services.horizons import HorizonScores
from tidemap.services.predict import PredictQuery, predict_at
from tidemap.spectral.evaluation import score

MINUTE = 60.0


def door_states(n: int) -> np.ndarray:
    """Open for stretches of minutes that differ, the same in every run."""
    return np.repeat(np.arange(n) % 2, np.random.default_rng(5).integers(2, 40, n))[:n].astype(np.uint8)


def ask(ctx: Context, name: str, **query: Any) -> list[HorizonScores]:
    return evaluate(ctx, name, EvaluateQuery(**query)).horizons


@pytest.mark.parametrize("hold_s", [None, 600.0])
@pytest.mark.parametrize("sensor", [None, {"miss": 0.1, "false_alarm": 0.05}, "learn"])
def test_the_scores_are_those_of_the_answers_as_of_then(
    ctx: Context, clock: Clock, hold_s: float | None, sensor: dict[str, float] | str | None
) -> None:
    held: dict[str, Any] = {} if hold_s is None else {"missing": "hold", "hold_s": hold_s}
    make_location(ctx, "door", None, estimator="static", sensor=sensor, **held)
    random = np.random.default_rng(2)
    states, read = door_states(500), np.flatnonzero(random.random(500) < 0.8)
    if sensor is not None:
        states ^= random.random(500) < 0.1
    post_states(ctx, "door", MINUTE * read[read < 400], states[read[read < 400]])
    clock.now = MINUTE * 400 - 1
    rates = refit(ctx, "door").detector
    clock.now = NOW
    post_states(ctx, "door", MINUTE * read[read >= 400], states[read[read >= 400]])
    # What is held is a reading itself, but not where readings err.
    sample = np.arange(400, 500) if hold_s is not None and sensor is None else read[read >= 400]
    truth = states[read[np.searchsorted(read, sample, side="right") - 1]]
    horizons = [60.0, 300.0, 3600.0]
    found = ask(ctx, "door", horizons_s=horizons, start=MINUTE * 400, stop=MINUTE * 500)
    for each, horizon_s in zip(found, horizons, strict=True):
        p: Any = [answer(ctx, MINUTE * n, horizon_s) for n in sample.tolist()]
        expected = score(p if rates is None else rates.sensor.reading_probability(p), truth)
        assert each.conditioned.scores.n == len(sample)
        assert each.conditioned.scores.log_loss == pytest.approx(expected.log_loss, rel=1e-4)
        assert each.conditioned.scores.brier == pytest.approx(expected.brier, rel=1e-4)
    assert found[0].conditioned.scores.log_loss < found[0].rhythm.scores.log_loss


def answer(ctx: Context, time: float, horizon_s: float) -> float:
    """p of the door's sample, given what was read in the one so long before it, or earlier."""
    query = PredictQuery([time], as_of=time - horizon_s + MINUTE - 1, given="observations")
    return float(predict_at(ctx, "door", query).probability[0, 0])


def test_changing_cells_of_a_grid_are_scored_spread_evenly(ctx: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    make_location(ctx, "lab", (40, 40), estimator="static")
    states = door_states(200)
    changing = range(0, 1600, 200)
    rows = [(MINUTE * n, cell, int(states[n - cell // 200])) for n in range(200) for cell in changing]
    post_rows(ctx, "lab", rows + [(MINUTE * n, 7, 1) for n in range(200)])
    refit(ctx, "lab")
    (one,) = ask(ctx, "lab", horizons_s=[60.0], start=MINUTE * 150)
    assert one.rhythm.scores.n == 8 * 50, "the cell that never changes is left out"
    monkeypatch.setattr("tidemap.services.horizons.MAX_PREDICTIONS", 200)
    (few,) = ask(ctx, "lab", horizons_s=[60.0], start=MINUTE * 150)
    assert few.rhythm.scores.n == 4 * 50


def test_what_cannot_be_walked_is_refused(ctx: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    make_location(ctx, "door", estimator="static")
    post_states(ctx, "door", MINUTE * np.arange(100), np.arange(100) >= 90)
    refit(ctx, "door")
    for start, train_start in ((0.0, None), (MINUTE * 100, None), (MINUTE * 50, None), (MINUTE * 95, MINUTE * 95)):
        with pytest.raises(InvalidInputError) as caught:
            ask(ctx, "door", horizons_s=[60.0], start=start, train_start=train_start)
        assert caught.value.errors[0].field == "start"
    assert ask(ctx, "door", horizons_s=[60.0], start=MINUTE * 95)[0].conditioned.scores.n == 5
    monkeypatch.setattr("tidemap.services.horizons.MAX_PREDICTIONS", 9)
    with pytest.raises(InvalidInputError, match="5 samples at 2 horizons are more than 9 predictions"):
        ask(ctx, "door", horizons_s=[60.0, 120.0], start=MINUTE * 95)

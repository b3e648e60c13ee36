"""Every answer about a time says the same p, and a reading then is judged by it; on both kinds of database."""

import numpy as np
import pytest

from tests.support.contexts import NOW, make_location, post_rows, post_states, refit
from tidemap.services.context import Context
from tidemap.services.detect import DetectQuery, detect
from tidemap.services.predict import PredictQuery, predict_at
from tidemap.services.series import SeriesQuery, series
from tidemap.services.state import StateQuery, state_at

DAY_S = 86_400.0


@pytest.mark.parametrize("estimator", ["auto", "calendar", "fft", "static"])
@pytest.mark.parametrize(("interval_s", "phase_s"), [(60.0, 59.0), (3600.0, 60.0), (3600.0, 3300.0), (700.3, 0.0)])
def test_predict_state_series_detect_and_the_judge_say_the_same(
    ctx: Context, estimator: str, interval_s: float, phase_s: float
) -> None:
    make_location(ctx, "door", interval_s=interval_s, estimator=estimator, confidence=0.51, time_zone="Europe/London")
    every = max(interval_s, 1800.0)
    time = np.arange(NOW - 20 * DAY_S, NOW - every, every) + phase_s
    is_open = (
        (time % DAY_S >= 8 * 3600) & (time % DAY_S < 18 * 3600) & (np.random.default_rng(1).random(time.size) < 0.9)
    )
    post_states(ctx, "door", time, is_open)
    refit(ctx, "door")
    for at in np.random.default_rng(2).uniform(NOW - 15 * DAY_S, NOW - 2 * DAY_S, 12).tolist():
        p = float(predict_at(ctx, "door", PredictQuery([at])).probability[0, 0])
        assert state_at(ctx, "door", StateQuery(at)).probability[0] == pytest.approx(p, abs=1e-6)
        one = series(ctx, "door", SeriesQuery(start=at, stop=at + 0.01, step=1.0))
        assert (one.time.tolist(), one.probability[0]) == ([at], pytest.approx(p, abs=1e-6))
        if abs(p - 0.5) > 0.02:
            (event,) = post_states(ctx, "door", [at], [int(p < 0.5)]).anomalies
            assert event.probability == pytest.approx(p, abs=1e-6)
    events, _ = detect(ctx, "door", DetectQuery(NOW - 15 * DAY_S, NOW - 2 * DAY_S))
    short = [event for event in events if event.stop - event.start < 1.5 * interval_s]
    assert short
    p = predict_at(ctx, "door", PredictQuery([event.start for event in short])).probability[0]
    np.testing.assert_allclose([event.probability for event in short], p, atol=1e-6)


def test_a_post_with_nothing_to_judge_is_stored(ctx: Context) -> None:
    make_location(ctx, "lab", (4, 4), combine="any", estimator="static")
    post_rows(ctx, "lab", [(NOW - 60.0 * n, cell, n % 2) for n in range(1, 20) for cell in range(16)])
    refit(ctx, "lab")
    done = post_rows(ctx, "lab", [(NOW - 7200.0, 3, 0)])
    assert (done.accepted, done.anomalies) == (1, [])

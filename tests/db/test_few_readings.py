"""What few readings make: a cautious mean, by every estimator, on both kinds of database."""

import numpy as np
import pytest

from tests.support.contexts import NOW, Clock, at_work, elected, make_location, opened, post_states, refit
from tests.support.waiting import until
from tidemap.services.context import Context
from tidemap.services.locations import find_location
from tidemap.services.model import model_of
from tidemap.services.predict import PredictQuery, predict_at
from tidemap.services.state import StateQuery, state_at
from tidemap.workers.updater import Updater

HOUR_S, DAY_S = 3600.0, 86_400.0


def test_3_two_readings_make_no_certainty(database_url: str) -> None:
    clock = Clock()
    with opened(database_url, clock, updater=True, updater_interval_s=0.02) as ctx:
        make_location(ctx, "door", time_zone="Europe/London")
        with elected(ctx) as election, at_work(Updater(ctx, election)):
            for ago_s in (2 * HOUR_S, HOUR_S):
                post_states(ctx, "door", [NOW - ago_s], [1])
            until(lambda: find_location(ctx, "door").revision)
            p = predict_at(ctx, "door", PredictQuery([NOW - DAY_S, NOW, NOW + DAY_S]))
            np.testing.assert_allclose(p.probability, 2.5 / 3, rtol=1e-6)
            assert np.all(p.entropy > 0.6)
            assert post_states(ctx, "door", [NOW], [0]).anomalies == []
            clock.now += ctx.settings.update_rest_s
            until(lambda: find_location(ctx, "door").revision == 2)
            p = predict_at(ctx, "door", PredictQuery([NOW + HOUR_S]))
            np.testing.assert_allclose(p.probability, 2.5 / 4, rtol=1e-6)


@pytest.mark.parametrize("estimator", ["auto", "static", "fft", "calendar"])
@pytest.mark.parametrize(("state", "expected"), [([1, 1], 2.5 / 3), ([0, 0], 0.5 / 3), ([1, 0], 0.5)])
def test_3_by_every_estimator(ctx: Context, estimator: str, state: list[int], expected: float) -> None:
    make_location(ctx, "door", estimator=estimator)
    post_states(ctx, "door", [NOW - 2 * HOUR_S, NOW - HOUR_S], state)
    refit(ctx, "door")
    p = state_at(ctx, "door", StateQuery(NOW)).probability[0]
    assert p == pytest.approx(expected, abs=1e-6 if state[0] == state[1] else 0.45)
    assert 0.05 < p < 0.95


@pytest.mark.parametrize("days_apart", [1, 20])
def test_3_readings_count_and_not_what_they_span(ctx: Context, days_apart: int) -> None:
    make_location(ctx, "door", interval_s=60.0)
    time = NOW - DAY_S * days_apart * np.arange(10, 0, -1)
    post_states(ctx, "door", time, np.arange(10) % 2)
    refit(ctx, "door")
    told = model_of(ctx, "door")
    assert told.revision.estimator == "static"
    assert told.revision.selection is not None
    assert "only 10 readings" in told.revision.selection["reason"]

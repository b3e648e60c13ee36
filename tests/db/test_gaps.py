"""A rhythm after a long gap, through the services, on both kinds of database."""

from typing import Any

import numpy as np
import pytest

from tests.support.contexts import Clock, make_location, opened, post_rows, post_states, refit
from tidemap.services.model import model_of
from tidemap.services.predict import PredictQuery, predict_at

DAY_S = 86_400.0
WEEK_S = 7 * DAY_S
MONDAY = 1_672_617_600.0
"""2 January 2023."""


def is_open(time: Any) -> Any:
    """From 8 to 18 on weekdays."""
    since = time - MONDAY
    return (since % WEEK_S < 5 * DAY_S) & (since % DAY_S >= 8 * 3600) & (since % DAY_S < 18 * 3600)


@pytest.mark.parametrize("after", [1, 3 * 144])
@pytest.mark.parametrize(("estimator", "most"), [("auto", 0.01), ("calendar", 0.01), ("fft", 0.06)])
def test_4_a_rhythm_is_known_after_a_long_gap(database_url: str, after: int, estimator: str, most: float) -> None:
    stop = MONDAY + 34 * WEEK_S + 600 * after
    with opened(database_url, Clock(stop)) as ctx:
        make_location(ctx, "door", interval_s=600.0, estimator=estimator)
        for start, end in ((MONDAY, MONDAY + 4 * WEEK_S), (MONDAY + 34 * WEEK_S, stop)):
            time = np.arange(start, end, 600.0)
            post_states(ctx, "door", time, is_open(time))
        record = refit(ctx, "door")
        assert record.estimator == ("calendar" if estimator == "auto" else estimator)
        ahead = np.arange(stop, stop + WEEK_S, 600.0)
        p = predict_at(ctx, "door", PredictQuery(ahead.tolist())).probability[0]
        assert np.mean((p > 0.5) != is_open(ahead)) <= most
        told = model_of(ctx, "door")
        if estimator == "fft":
            fitted = told.location.base.time([record.start, record.stop]).tolist()
            assert fitted == [MONDAY, MONDAY + 4 * WEEK_S]
        assert told.accuracy is not None
        assert told.accuracy >= 1 - most


def test_4_a_pause_of_a_grid_is_one_of_all_its_chunks(database_url: str) -> None:
    """Of two chunks one has not been seen for weeks, but the other has: no pause."""
    hour = np.arange(0.0, 8 * WEEK_S, 3600.0)
    with opened(database_url, Clock(MONDAY + 40 * WEEK_S)) as ctx:
        make_location(ctx, "lab", (40, 40), interval_s=3600.0, estimator="fft", order=2)
        rows = [(MONDAY + since, 3, int(is_open(MONDAY + since))) for since in hour[: 4 * 168].tolist()]
        rows += [(MONDAY + since, 1500, int(is_open(MONDAY + since))) for since in hour.tolist()]
        post_rows(ctx, "lab", rows)
        record = refit(ctx, "lab")
        assert record.stop - record.start == 8 * 168
        post_rows(ctx, "lab", [(MONDAY + 30 * WEEK_S, 3, 1)])
        record = refit(ctx, "lab")
        assert record.stop - record.start == 8 * 168
        assert record.start == MONDAY / 3600
        p = predict_at(ctx, "lab", PredictQuery([MONDAY + 31 * WEEK_S + 13 * 3600], [3, 1500])).probability
        assert np.all(p > 0.6)

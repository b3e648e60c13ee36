"""A reading of a clock that was wrong, where the settings take it: it stands far from all others and spoils nothing."""

import numpy as np
import pytest

from tests.support.contexts import NOW, compact_now, make_location, opened, post_states, refit
from tidemap.history.history import UNOBSERVED
from tidemap.services.context import Context
from tidemap.services.history import window
from tidemap.services.locations import find_location, get_location
from tidemap.services.series import SeriesQuery, series

DAY = 86_400.0
MINUTES = 28 * 1440
START = NOW - NOW % DAY - 28 * DAY
TIMES = START + 600.0 * np.arange(28 * 144)


def open_by_day(ctx: Context, earlier: float = 0.0) -> None:
    make_location(ctx, "door")
    post_states(ctx, "door", TIMES - earlier, (TIMES % DAY // 3600 >= 8) & (TIMES % DAY // 3600 < 18))


@pytest.mark.parametrize("compacted", [False, True])
def test_the_window_and_the_series_are_those_of_the_other_readings(ctx: Context, compacted: bool) -> None:
    open_by_day(ctx)
    post_states(ctx, "door", [37.0], [1])
    if compacted:
        compact_now(ctx, "door")
    location = find_location(ctx, "door")
    assert location.first_time == 37.0
    first, last = window(ctx, location)
    assert last - first <= MINUTES + 4096
    view = series(ctx, "door")
    assert view.time[-1] == TIMES[-1]
    assert np.count_nonzero(view.observed != UNOBSERVED) == len(TIMES)


@pytest.mark.parametrize("estimator", ["fft", "calendar"])
def test_a_model_is_fitted_to_the_other_readings(ctx: Context, estimator: str) -> None:
    open_by_day(ctx)
    post_states(ctx, "door", [37.0], [1])
    revision = refit(ctx, "door", estimator=estimator, order=2)
    assert revision.stop - revision.start <= MINUTES + 4096
    assert get_location(ctx, "door").first_time == 37.0


def test_a_rhythm_before_a_long_gap_is_not_a_wrong_clock(ctx: Context) -> None:
    """30 weeks are no year; and before two years more was seen than since."""
    earlier = 3 * 365 * DAY
    open_by_day(ctx, earlier)
    first = find_location(ctx, "door").base.sample(START - earlier)
    for later in (210 * DAY, 2 * 365 * DAY):
        post_states(ctx, "door", [START - earlier + later], [1])
        assert window(ctx, find_location(ctx, "door"))[0] == first


def test_a_series_without_bounds_is_no_longer_than_an_answer_may_be(database_url: str) -> None:
    with opened(database_url, max_points=1000) as ctx:
        open_by_day(ctx)
        view = series(ctx, "door")
        assert (len(view.time), view.time[-1]) == (999, TIMES[-1])
        assert len(series(ctx, "door", SeriesQuery(step=3600.0)).time) == 28 * 24

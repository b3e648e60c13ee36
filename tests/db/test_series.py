"""What `series` shows of readings, whatever its steps, and of a state that is held; on both kinds of database."""

from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.support.contexts import Clock, compact_now, make_location, opened, post_rows, post_states, refit
from tidemap.history.history import UNOBSERVED
from tidemap.services.context import Context
from tidemap.services.detect import DetectQuery, detect
from tidemap.services.series import SeriesQuery, series
from tidemap.services.state import StateQuery, state_at

DAY_S = 86_400.0
FRIDAY = datetime(2023, 5, 5, tzinfo=UTC).timestamp()
SATURDAY = FRIDAY + DAY_S
HOUR_S = 3600.0
RANDOM_NAMES = (f"door-{n}" for n in range(10**6))


def test_5_a_held_state_is_shown_until_it_ends_and_never_beyond_now(database_url: str) -> None:
    clock = Clock(FRIDAY + 20 * HOUR_S)
    with opened(database_url, clock) as ctx:
        make_location(ctx, "door", missing="hold", hold_s=3 * DAY_S, interval_s=600.0, estimator="static")
        post_states(ctx, "door", [FRIDAY + 8 * HOUR_S], [1])

        def observed(start: float, stop: float, step: float | None = None) -> list[int]:
            view = series(ctx, "door", SeriesQuery(start=start, stop=stop, step=step))
            return [int(state) for state in view.observed]

        assert observed(clock.now, clock.now + 600) == [1]
        assert observed(clock.now + 600, clock.now + 1200) == [UNOBSERVED], "nothing is known of what is to come"
        assert series(ctx, "door").observed.tolist() == [1] * 73
        for held_s, shown in ((71.9 * HOUR_S, 1), (72.2 * HOUR_S, UNOBSERVED), (30 * DAY_S, UNOBSERVED)):
            clock.now = FRIDAY + 8 * HOUR_S + held_s
            assert observed(clock.now, clock.now + 600) == [shown]
        assert len(series(ctx, "door").time) == 1 + 3 * 144
        clock.now = SATURDAY + 13 * HOUR_S
        post_states(ctx, "door", [SATURDAY + 12 * HOUR_S + 50 * 60], [0])
        compact_now(ctx, "door")
        part = observed(FRIDAY + 7 * HOUR_S, clock.now)
        assert part == [UNOBSERVED] * 6 + [1] * 173 + [0]
        hours = observed(FRIDAY + 7 * HOUR_S, clock.now + 2 * HOUR_S, HOUR_S)
        assert hours == [UNOBSERVED] + [1] * 28 + [0, 0, UNOBSERVED]


def test_5_what_is_held_is_learned_from_searched_and_last_seen(database_url: str) -> None:
    clock = Clock(FRIDAY + 8 * HOUR_S)
    with opened(database_url, clock) as ctx:
        make_location(ctx, "door", missing="hold", hold_s=3 * DAY_S, interval_s=600.0, estimator="static")
        post_states(ctx, "door", FRIDAY - DAY_S * np.arange(20.0, 0, -1), np.zeros(20))
        refit(ctx, "door")
        post_states(ctx, "door", [FRIDAY + 8 * HOUR_S], [1])
        clock.now = FRIDAY + 20 * HOUR_S
        (event,), _ = detect(ctx, "door", DetectQuery(FRIDAY, FRIDAY + 3 * DAY_S))
        assert (event.start, event.stop) == (FRIDAY + 8 * HOUR_S, clock.now + 600)
        view = state_at(ctx, "door", StateQuery(clock.now, observed=True))
        assert view.observed is not None
        assert view.observed_time is not None
        assert (view.observed.tolist(), view.observed_time.tolist()) == ([1], [FRIDAY + 8 * HOUR_S])
        record = refit(ctx, "door")
        assert record.stop == (clock.now + 600) / 600
        p = float(state_at(ctx, "door", StateQuery(clock.now)).probability[0])
        assert p == pytest.approx(73.5 / (20 * 144 + 48 + 73 + 1), rel=1e-5)


@pytest.mark.parametrize("offset_s", [0.0, 60.0, 300.0, 29.0, 30.0, 31.0, 599.5])
@pytest.mark.parametrize("second", [0.0, 10.0, 45.0])
def test_8_every_reading_is_shown_in_the_step_in_which_it_lies(ctx: Context, offset_s: float, second: float) -> None:
    make_location(ctx, "door", interval_s=60.0)
    time = FRIDAY + 600.0 * np.arange(1, 145) + second
    state = np.random.default_rng(2).integers(0, 2, 144)
    post_states(ctx, "door", time, state)
    start = FRIDAY + offset_s
    view = series(ctx, "door", SeriesQuery(start=start, stop=start + DAY_S + 600, step=600.0))
    shown = np.full(145, UNOBSERVED)
    shown[np.floor((time - start) / 600).astype(int)] = state
    sure = shown != UNOBSERVED
    assert sure.sum() == 144
    np.testing.assert_array_equal(view.observed[sure], shown[sure])


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    readings=st.lists(st.tuples(st.integers(0, 40_000), st.integers(0, 1)), min_size=1, unique_by=lambda each: each[0]),
    start=st.integers(-5000, 40_000),
    step=st.sampled_from([61, 90, 600, 3601, 20_000]),
    compacted=st.integers(0, 40),
)
def test_a_step_shows_the_latest_of_its_readings(
    ctx: Context, readings: list[tuple[int, int]], start: int, step: int, compacted: int
) -> None:
    name = next(RANDOM_NAMES)
    make_location(ctx, name, (2, 2))
    for rows in (readings[:compacted], readings[compacted:]):
        post_rows(ctx, name, [(FRIDAY + time, 3, state) for time, state in rows] or [(FRIDAY, 0, 1)])
        if rows is not readings[compacted:]:
            compact_now(ctx, name)
    view = series(ctx, name, SeriesQuery(3, FRIDAY + start, FRIDAY + 45_000, float(step)))
    latest = dict(sorted((time // 60, (time, state)) for time, state in sorted(readings)))
    for at, shown in zip(view.time - FRIDAY, view.observed, strict=True):
        inside = [state for time, state in latest.values() if at <= time < at + step]
        around = latest.get(int(at // 60), (0, UNOBSERVED))[1]
        assert shown == (inside[-1] if inside else around)

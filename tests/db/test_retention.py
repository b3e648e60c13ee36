"""Retention: what is older by the clock is not stored, or not any more, and whoever posts it is told."""

from collections.abc import Iterator

import numpy as np
import pytest

from tests.support.contexts import NOW, Clock, compact_now, elected, make_location, opened, post_states, refit
from tests.support.contexts import at_work as run
from tests.support.waiting import until
from tidemap.events.messages import EventMessage
from tidemap.history.history import UNOBSERVED
from tidemap.services.compaction import forget_everywhere
from tidemap.services.context import Context
from tidemap.services.locations import LocationChanges, change_location, get_location
from tidemap.services.series import series
from tidemap.services.verify import verify
from tidemap.workers.compactor import Compactor

HOUR, DAY = 3600.0, 86_400.0


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def ctx(database_url: str, clock: Clock) -> Iterator[Context]:
    with opened(database_url, clock) as context:
        make_location(context, "door", interval_s=HOUR, retention=DAY)
        yield context
        verify(database_url, lambda finding: pytest.fail(str(finding)))


def n_observed(ctx: Context) -> int:
    return int(np.count_nonzero(series(ctx, "door").observed != UNOBSERVED))


def test_of_a_post_what_is_too_old_is_dropped_and_told(ctx: Context) -> None:
    heard: list[EventMessage] = []
    ctx.bus.subscribe(heard.append)
    answer = post_states(ctx, "door", [NOW, NOW - DAY, NOW - DAY - 1, NOW - 9 * DAY], [1, 0, 1, 1])
    assert (answer.accepted, answer.dropped, answer.first_time, answer.last_time) == (2, 2, NOW - DAY, NOW)
    assert get_location(ctx, "door").observations == 2
    refit(ctx, "door", estimator="static")
    assert n_observed(ctx) == 2
    assert [message.data["measurements"] for message in heard if message.kind == "observation"] == [2]


def test_of_what_is_all_too_old_nothing_is_stored(ctx: Context) -> None:
    heard: list[EventMessage] = []
    ctx.bus.subscribe(heard.append)
    for _ in range(2):
        answer = post_states(ctx, "door", [NOW - 2 * DAY, NOW - 3 * DAY], [1, 0], idempotency_key="k")
        assert (answer.accepted, answer.dropped, answer.duplicate, answer.number) == (0, 2, False, 0)
        assert (answer.first_time, answer.last_time, answer.anomalies) == (None, None, [])
    shown = get_location(ctx, "door")
    assert (shown.observations, shown.first_time, shown.last_time, heard) == (0, None, None, [])


def test_a_key_is_a_key_whatever_was_dropped_meanwhile(ctx: Context, clock: Clock) -> None:
    sent = ([NOW - DAY + 1, NOW], [1, 0])
    assert post_states(ctx, "door", *sent, idempotency_key="k").accepted == 2
    for later, dropped in ((HOUR, 0), (3 * DAY, 0)):
        clock.now = NOW + later
        again = post_states(ctx, "door", *sent, idempotency_key="k")
        assert (again.accepted, again.dropped, again.duplicate) == (0, dropped, True)


@pytest.mark.parametrize("compacted", [False, True])
def test_the_clock_counts_and_not_the_last_reading(ctx: Context, clock: Clock, compacted: bool) -> None:
    post_states(ctx, "door", NOW - HOUR * np.arange(24), np.arange(24) % 2)
    if compacted:
        compact_now(ctx, "door")
    clock.now += 12 * HOUR
    forget_everywhere(ctx)
    shown = get_location(ctx, "door")
    assert n_observed(ctx) == 13
    assert (shown.first_time, shown.last_time) == (NOW - 12 * HOUR, NOW)
    refit(ctx, "door", estimator="static")
    clock.now += 3 * DAY
    forget_everywhere(ctx)
    shown = get_location(ctx, "door")
    assert (shown.first_time, shown.last_time, shown.observations, shown.revision) == (None, None, 0, 1)
    assert n_observed(ctx) == 0


def test_the_first_time_is_that_of_a_reading(ctx: Context, clock: Clock) -> None:
    post_states(ctx, "door", [NOW - 20 * HOUR + 7, NOW - 3 * HOUR + 7, NOW], [1, 0, 1])
    clock.now += 10 * HOUR
    refit(ctx, "door", estimator="static")
    assert get_location(ctx, "door").first_time == NOW - 3 * HOUR + 7


def test_a_location_without_it_keeps_everything(ctx: Context, clock: Clock) -> None:
    change_location(ctx, "door", LocationChanges(retention_s=None))
    assert post_states(ctx, "door", [NOW - 9 * DAY, NOW], [1, 0]).dropped == 0
    clock.now += 99 * DAY
    forget_everywhere(ctx)
    assert n_observed(ctx) == 2


def test_it_is_looked_after_where_nobody_posts_any_more(database_url: str, clock: Clock) -> None:
    with opened(database_url, clock, updater=True) as ctx:
        make_location(ctx, "hall", interval_s=HOUR, retention=DAY)
        post_states(ctx, "hall", [NOW], [1])
        clock.now += 2 * DAY
        with elected(ctx) as election, run(Compactor(ctx, election)):
            until(lambda: get_location(ctx, "hall").first_time is None)

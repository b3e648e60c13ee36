"""The watcher: what stands is judged where this process leads."""

import numpy as np

from tests.support.contexts import Clock, at_work, elected, make_location, post_states, refit
from tests.support.waiting import until
from tidemap.events.messages import EventMessage
from tidemap.services.anomalies import EventQuery, list_events
from tidemap.services.context import Context
from tidemap.services.locations import find_location
from tidemap.workers.election import LeaderElection
from tidemap.workers.watcher import Watcher

MINUTE = 60.0


def open_door(ctx: Context, clock: Clock) -> None:
    """A door that never stood open, and does since minute 100; it is minute 130."""
    make_location(ctx, "door", missing="hold", hold_s=1e6, estimator="static")
    clock.now = MINUTE * 100
    post_states(ctx, "door", MINUTE * np.arange(100), np.zeros(100))
    refit(ctx, "door")
    post_states(ctx, "door", [MINUTE * 100], [1])
    clock.now = MINUTE * 130


def stops(ctx: Context) -> list[float]:
    return [event.stop / MINUTE for event in list_events(ctx, EventQuery())]


def test_the_leader_says_how_long_it_lasts(lively: Context, clock: Clock) -> None:
    open_door(lively, clock)
    heard: list[EventMessage] = []
    lively.bus.subscribe(lambda message: heard.append(message) if message.kind == "anomaly" else None)
    assert stops(lively) == [101]
    with elected(lively) as election, at_work(Watcher(lively, election)):
        until(lambda: stops(lively) == [130])
        clock.now = MINUTE * 140.5
        until(lambda: stops(lively) == [140])
    assert [message.data["update"] for message in heard] == [True, True]


def test_nobody_else_does(lively: Context, clock: Clock) -> None:
    open_door(lively, clock)
    judged = find_location(lively, "door").judged_to
    watcher = Watcher(lively, LeaderElection(lively))
    watcher._round()
    assert (stops(lively), find_location(lively, "door").judged_to) == ([101], judged)

"""Silence is an event of its own: who usually speaks and does not, by their own rhythm; on SQLite and PostgreSQL."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from tests.support.contexts import Clock, make_location, opened, post_states
from tidemap.events.messages import EventMessage
from tidemap.scope import Scope
from tidemap.services.anomalies import Anomaly, EventQuery, list_events
from tidemap.services.context import Context
from tidemap.services.locations import get_location
from tidemap.services.mutes import NewMute, create_mute
from tidemap.services.silence import INTERVAL_S, Silences
from tidemap.storage.records import ObservationRecord
from tidemap.storage.repositories.anomalies import SILENCE

DAY, HOUR, MINUTE = 86_400.0, 3600.0, 60.0
MONDAY = 1_700_438_400.0
SATURDAY = MONDAY + 5 * DAY
"""Midnights."""
Speaks = Callable[[float], bool]


def always(_: float) -> bool:
    """Day and night."""
    return True


def by_day(time: float) -> bool:
    """From 9 to 17 on weekdays."""
    return (time - MONDAY) % (7 * DAY) < 5 * DAY and 9 <= time % DAY / HOUR < 17


class Watched:
    """A site whose watcher looks every two and a half minutes."""

    def __init__(self, ctx: Context, clock: Clock) -> None:
        self.ctx, self.clock, self.silences = ctx, clock, Silences()
        self.heard: list[EventMessage] = []
        ctx.bus.subscribe(lambda each: self.heard.append(each) if each.kind == "anomaly" else None)

    def history(self, name: str, speaks: Speaks, stop: float, weeks: int = 4) -> None:
        """A location that was heard every five minutes when it speaks, up to a time; written as posts would be."""
        make_location(self.ctx, name)
        times = [t for t in np.arange(stop - weeks * 7 * DAY, stop, INTERVAL_S).tolist() if speaks(t)]
        records = [ObservationRecord(t, None, 0, t, t, None, None, b"") for t in times]
        location_id = get_location(self.ctx, name).id
        self.ctx.store.write(lambda work: work.observations.append(location_id, records))

    def pass_time(
        self, until: float, speaks: Speaks = lambda _: False, name: str = "door", step: float = INTERVAL_S / 2
    ) -> None:
        """Time passes, and the location is heard whenever it speaks."""
        while self.clock.now < until:
            self.clock.now += step
            if self.clock.now % INTERVAL_S == 0 and speaks(self.clock.now):
                post_states(self.ctx, name, [self.clock.now], [0])
            self.silences.watch(self.ctx)

    def restart(self) -> None:
        """As another server that takes over does."""
        self.silences = Silences()

    def events(self) -> list[Anomaly]:
        found = list_events(self.ctx, EventQuery())
        assert {each.rule for each in found} <= {SILENCE}
        return found


@contextmanager
def watched(url: str, now: float) -> Iterator[Watched]:
    clock = Clock(now)
    with opened(url, clock) as ctx:
        yield Watched(ctx, clock)


def test_a_silence_is_one_event_until_the_next_post_whatever_restarts(database_url: str) -> None:
    with watched(database_url, MONDAY) as site:
        site.history("door", always, MONDAY)
        site.pass_time(MONDAY + HOUR, always)
        assert site.events() == []
        for _ in range(3):
            site.pass_time(site.clock.now + HOUR)
            site.restart()
        (event,) = site.events()
        assert (event.start, event.ended, event.cells.tolist()) == (MONDAY + HOUR, False, [])
        assert 10 * MINUTE < event.stop - event.start <= 30 * MINUTE
        assert event.surprise == event.probability > event.confidence > 0.9
        assert get_location(site.ctx, "door").open_anomalies == 1
        site.pass_time(MONDAY + 5 * HOUR, always)
        (event,) = site.events()
        assert (event.stop, event.ended) == (MONDAY + 4 * HOUR + INTERVAL_S, True)
        assert [each.wire()["update"] for each in site.heard] == [False, True]
        assert site.heard[0].wire() | {"rule": SILENCE, "observed": None, "cells": []} == site.heard[0].wire()
        site.pass_time(MONDAY + 6 * HOUR)
        assert [each.id for each in site.events()] == [event.id, event.id + 2], "the next one is another"


def test_nights_and_weekends_are_no_silence_but_a_morning_is(
    database_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tidemap.services.silence.MAX_UNHEARD_S", HOUR)
    with watched(database_url, SATURDAY) as site:
        site.history("robot", by_day, SATURDAY)
        make_location(site.ctx, "idle")
        site.history("once", lambda t: SATURDAY - 6 * DAY < t < SATURDAY - 5 * DAY, SATURDAY)
        site.pass_time(MONDAY + 7 * DAY + 9 * HOUR, step=HOUR / 2)
        assert site.events() == []
        site.pass_time(MONDAY + 7 * DAY + 12 * HOUR, step=HOUR / 2)
        (event,) = site.events()
        assert event.location == "robot"
        assert event.start == SATURDAY - 7 * HOUR - INTERVAL_S
        assert MONDAY + 7 * DAY + 9 * HOUR < event.stop < MONDAY + 7 * DAY + 10.5 * HOUR


def test_while_no_server_listens_nobody_is_silent(database_url: str) -> None:
    with watched(database_url, MONDAY) as site:
        for name in ("door", "gate"):
            site.history(name, always, MONDAY)
        site.silences.watch(site.ctx)
        site.clock.now = MONDAY + 2 * DAY
        site.restart()
        site.pass_time(site.clock.now + 10 * MINUTE)
        site.pass_time(site.clock.now + 2 * HOUR, always, "gate")
        (event,) = site.events()
        assert event.location == "door"
        assert event.stop > MONDAY + 2 * DAY + 10 * MINUTE


@pytest.mark.parametrize("jump", [-300 * DAY, 300 * DAY])
def test_a_clock_of_the_server_that_jumps_makes_no_silence(database_url: str, jump: float) -> None:
    with watched(database_url, MONDAY) as site:
        site.history("door", always, MONDAY)
        site.pass_time(MONDAY + HOUR, always)
        site.clock.now += jump
        site.pass_time(site.clock.now + HOUR, always)
        site.clock.now -= jump
        site.pass_time(site.clock.now + 2 * HOUR, always)
        assert site.events() == []


def test_a_robot_with_a_wrong_clock_has_spoken(database_url: str) -> None:
    with watched(database_url, MONDAY) as site:
        site.history("door", always, MONDAY)
        for _ in range(20):
            site.clock.now += INTERVAL_S
            post_states(site.ctx, "door", [site.clock.now - 20 * DAY], [0])
            site.silences.watch(site.ctx)
        assert site.events() == []


def test_a_silence_that_outlasts_the_time_it_is_muted_is_published_then(database_url: str) -> None:
    with watched(database_url, MONDAY) as site:
        site.history("door", always, MONDAY)
        create_mute(site.ctx, NewMute(Scope(("door",)), MONDAY + HOUR / 2, MONDAY + 5 * HOUR), "ann")
        site.pass_time(MONDAY + HOUR, always)
        site.pass_time(MONDAY + 4 * HOUR)
        assert [each.muted for each in site.events()] == [True]
        assert site.heard == []
        assert get_location(site.ctx, "door").open_anomalies == 0
        site.pass_time(MONDAY + 6 * HOUR)
        assert [each.muted for each in site.events()] == [False]
        assert [each.wire()["update"] for each in site.heard] == [False]

"""What a list of many locations shows, and the messages about locations."""

import re
from pathlib import Path

import numpy as np
import pytest
from anyio.from_thread import start_blocking_portal

from tests.api.house import Http
from tests.support.contexts import Clock, make_location, opened, post_states, refit
from tests.support.databases import SqliteDatabases
from tests.support.thousand import DAY_S, HOUR_S, fill, open_by_day
from tidemap.api.main import create_app
from tidemap.errors import InvalidInputError, RateLimitError
from tidemap.events.messages import EventMessage
from tidemap.services.anomalies import EventQuery, newest_events
from tidemap.services.context import Context
from tidemap.services.locations import change_location, delete_location
from tidemap.services.overview import overview, silent_since
from tidemap.services.posters import posters
from tidemap.services.refusals import MAX_REASON, counting
from tidemap.services.silence import INTERVAL_S, Silences
from tidemap.storage.records import ObservationRecord
from tidemap.storage.repositories.locations import LocationFilter
from tidemap.storage.repositories.sources import MAX_REFUSED, Refusals, SourceActivity
from tidemap_web.site import pages

MODELLED = 4


def wait_for_writes(ctx: Context) -> None:
    """Writes are done in their order."""
    ctx.store.write(lambda work: None)


def door(ctx: Context, name: str, until: float) -> None:
    """A location with a week of readings and a model of the day."""
    make_location(ctx, name, interval_s=HOUR_S)
    times, states = open_by_day(until)
    post_states(ctx, name, times, states, source="robot")
    refit(ctx, name, estimator="fft", order=4)


def test_now_and_the_next_change_are_those_of_the_rhythm_given_what_was_read(ctx: Context, clock: Clock) -> None:
    door(ctx, "door", clock.now)  # it is 22:13
    (row,) = overview(ctx, LocationFilter(), 0, 50).rows
    assert row.outlook is not None
    assert row.outlook.verdict == 0
    assert row.outlook.probability_now < 0.1
    assert row.outlook.change is not None
    assert row.outlook.becomes == 1
    assert abs(row.outlook.change % DAY_S / HOUR_S - 8) < 1
    assert len(row.outlook.probability) == len(row.outlook.time) == 97


def test_whose_silence_is_an_event_is_red_until_it_speaks(ctx: Context, clock: Clock) -> None:
    make_location(ctx, "door")
    start = clock.now
    times = np.arange(start - 28 * DAY_S, start, INTERVAL_S)
    records = [ObservationRecord(t, "a", 0, t, t, None, None, b"") for t in times.tolist()]
    ctx.store.write(lambda work: work.observations.append(work.locations.get("door").id, records))
    silences = Silences()

    def listen(until: float) -> tuple[float | None, dict[str, bool]]:
        while clock.now < until:
            clock.now += INTERVAL_S / 2
            silences.watch(ctx)
        (row,) = overview(ctx, LocationFilter(), 0, 50).rows
        assert silent_since(ctx, row.location) == row.silent_since
        return row.silent_since, {each.name: each.silent for each in posters(ctx, "door")}

    assert listen(start + 600) == (None, {"a": False})
    assert listen(start + HOUR_S) == (times[-1], {"a": True})
    post_states(ctx, "door", [clock.now], [0], source="b")
    # One of them speaks again: the other is silent still.
    assert listen(start + HOUR_S + 600) == (None, {"a": True, "b": False})


def test_locations_are_found_by_a_part_of_their_names_sorted_and_paged(ctx: Context, clock: Clock) -> None:
    for number, name in enumerate(["b_1", "a-2", "B-3", "bx1"]):
        make_location(ctx, name)
        if number != 1:
            post_states(ctx, name, [clock.now - number], [0])

    def names(wanted: LocationFilter, offset: int = 0, limit: int = 50) -> list[str]:
        return [row.location.name for row in overview(ctx, wanted, offset, limit).rows]

    assert names(LocationFilter(search="B_")) == ["b_1"]  # no sign stands for others
    assert names(LocationFilter(search="b", sort="seen", descending=True)) == ["b_1", "B-3", "bx1"]
    assert names(LocationFilter(sort="seen")) == ["bx1", "B-3", "b_1", "a-2"]  # what was never seen comes last
    assert names(LocationFilter(sort="seen"), offset=1, limit=2) == ["B-3", "b_1"]
    assert overview(ctx, LocationFilter(search="b"), 2, 1).total == 3
    assert names(LocationFilter(alarmed=True)) == []


def test_those_with_open_anomalies_are_counted_and_listed_newest_first(ctx: Context, clock: Clock) -> None:
    for name in ("door", "gate"):
        door(ctx, name, clock.now)
    for name, moment in (("door", 1.0), ("gate", HOUR_S), ("door", 5 * HOUR_S)):
        post_states(ctx, name, [clock.now + moment - DAY_S], [1])
    wanted = LocationFilter(alarmed=True, sort="anomalies", descending=True)
    found = {row.location.name: row.location.open_anomalies for row in overview(ctx, wanted, 0, 50).rows}
    assert list(found.items()) == [("door", 2), ("gate", 1)]
    events = newest_events(ctx, EventQuery(limit=10))
    ids = [event.id for _, event in events]
    assert ids == sorted(ids, reverse=True)
    assert {location.name for location, _ in newest_events(ctx, EventQuery(search="OO"))} == {"door"}
    assert [event.id for _, event in newest_events(ctx, EventQuery(), before=ids[0])] == ids[1:]


def test_robots_are_listed_with_what_they_posted_within_a_day(ctx: Context, clock: Clock) -> None:
    make_location(ctx, "lab")
    post_states(ctx, "lab", [clock.now - 2], [0], source="a")
    clock.now += 2 * DAY_S
    post_states(ctx, "lab", [clock.now - 1, clock.now], [0, 1], source="b")
    post_states(ctx, "lab", [clock.now + 1], [1])
    found = {each.name: each.activity for each in posters(ctx, "lab")}
    assert found == {
        "a": SourceActivity("a", 1, 0, 0, clock.now - 2 * DAY_S, clock.now - 2 * DAY_S - 2),
        "b": SourceActivity("b", 1, 1, 2, clock.now, clock.now),
        "": SourceActivity("", 1, 1, 1, clock.now, clock.now + 1),
    }


def test_refused_posts_are_counted_by_robot_with_the_last_reason(ctx: Context, clock: Clock) -> None:
    make_location(ctx, "lab")

    def refused(source: str | None, reason: str, location: str = "lab") -> None:
        with pytest.raises(InvalidInputError), counting(ctx, location, source):
            raise InvalidInputError.at("state", reason)

    start = clock.now
    refused("a", "first")
    clock.now += HOUR_S
    refused("a", "second")
    refused(None, "x" * 1000)
    refused("a", "nowhere", "garage")
    with pytest.raises(RateLimitError), counting(ctx, "lab", "a"):
        raise RateLimitError(1)
    wait_for_writes(ctx)
    found = {each.name: each.refused for each in posters(ctx, "lab")}
    assert found["a"] == Refusals("a", 2, start, clock.now, "state: second")
    assert found[""] is not None
    assert (found[""].count, len(found[""].reason)) == (1, MAX_REASON)

    clock.now += 2 * DAY_S
    refused("a", "third")
    for number in range(MAX_REFUSED + 5):
        clock.now += 1
        refused(f"robot {number}", "again")
    wait_for_writes(ctx)
    found = {each.name: each.refused for each in posters(ctx, "lab")}
    assert len(found) == MAX_REFUSED
    assert "a" not in found


def test_everybody_hears_what_becomes_of_a_location(ctx: Context) -> None:
    heard: list[EventMessage] = []
    ctx.bus.subscribe(heard.append)
    made = make_location(ctx, "old")
    change_location(ctx, "old", {"name": "new"})
    delete_location(ctx, "new")
    assert [(each.kind, each.location, each.id, each.data) for each in heard] == [
        ("location", "old", made.id, {"change": "created", "called": None}),
        ("location", "old", made.id, {"change": "changed", "called": "new"}),
        ("location", "new", made.id, {"change": "deleted", "called": None}),
    ]


def test_a_page_of_a_thousand_locations_is_small(tmp_path: Path, clock: Clock) -> None:
    with SqliteDatabases(tmp_path).migrated() as url, opened(url, clock) as ctx:
        fill(ctx, clock.now, MODELLED)
        app = create_app(ctx)
        with pages(ctx, app), start_blocking_portal() as portal:
            browser = Http(portal, app)
            body = browser.request("GET", "/").text
            rows = re.findall("<tr id.*?</tr>", body, re.DOTALL)
            assert len(rows) == 50
            shell = len(body.encode()) - sum(len(row.encode()) for row in rows)
            assert sum("<svg" in row for row in rows) == MODELLED
            assert shell + 50 * max(len(row.encode()) for row in rows) < 60_000  # with a model of every location
            assert "of 1,000" in body
            assert len(re.findall("<tr id", browser.request("GET", "/?q=-0999").text)) == 1
            assert len(re.findall("<tr id", browser.request("GET", "/?page=20").text)) == 50
            assert "No location is like this" in browser.request("GET", "/?page=21").text

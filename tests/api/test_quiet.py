"""What people do not want to hear of: snoozed events, and times that are muted; and when an event has ended."""

from collections.abc import Iterator
from typing import Any

import pytest

from tests.api.house import DAY, HOUR, NOW, Api, done, open_house, problem
from tests.support.databases import Databases
from tests.support.waiting import until
from tidemap.events.messages import EventMessage
from tidemap.schemas.common import iso
from tidemap.services.ending import end_events
from tidemap.services.locations import find_location
from tidemap.services.snoozing import end_snoozes

MINUTE = 60.0


@pytest.fixture(scope="module")
def house(databases: Databases, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Api]:
    with databases.migrated() as url, open_house(tmp_path_factory.mktemp("house"), url) as house:
        house.clock.now = NOW + DAY
        yield house


def door(house: Api, **settings: Any) -> str:
    """A location that was never occupied."""
    name = house.location(interval_s=MINUTE, estimator="static", confidence=0.75, **settings)
    house.observe(name, [NOW - HOUR * ago for ago in range(1, 21)], [0] * 20)
    house.update(name)
    return name


def alarm(house: Api, name: str, minute: float) -> dict[str, Any]:
    (event,) = house.observe(name, [NOW + MINUTE * minute], [1])["anomalies"]
    return dict(event)


def unheard(house: Api, name: str) -> tuple[int, list[bool]]:
    """How many events are open, and which are muted."""
    found = done(house.get(f"/locations/{name}/anomalies"))["items"]
    return done(house.get(f"/locations/{name}"))["open_anomalies"], [each["muted"] for each in found]


def test_a_snoozed_event_grows_unheard_and_comes_back(house: Api, heard: list[EventMessage]) -> None:
    name = door(house)
    number = alarm(house, name, 0)["id"]
    until(lambda: len(heard) == 1)
    over = house.clock.now + HOUR
    snoozed = done(house.post(f"/anomalies/{number}/snooze", {"until": over}))
    assert (snoozed["snoozed_by"], snoozed["snoozed_until"]) == ("anybody", iso(over))
    assert alarm(house, name, 1)["id"] == number
    assert unheard(house, name) == (0, [False])
    assert len(heard) == 1
    end_snoozes(house.ctx)
    assert len(heard) == 1
    house.clock.now = over
    end_snoozes(house.ctx)
    end_snoozes(house.ctx)
    until(lambda: len(heard) == 2)
    last = heard[-1].wire()
    assert (len(heard), last["update"], last["snoozed_until"], last["stop"]) == (2, True, None, iso(NOW + 2 * MINUTE))
    assert unheard(house, name) == (1, [False])
    form = {"until": over}
    problem(house.post(f"/anomalies/{number}/snooze", form), 422, "invalid-input")
    assert done(house.post(f"/anomalies/{number}/snooze", {"until": None}))["snoozed_by"] is None
    until(lambda: len(heard) == 3)


def test_what_people_say_is_published(house: Api) -> None:
    said: list[EventMessage] = []
    kinds = ("anomaly", "attention")
    end = house.ctx.bus.subscribe_own(lambda each: said.append(each) if each.kind in kinds else None)
    name = door(house)
    number = alarm(house, name, 0)["id"]
    done(house.post(f"/anomalies/{number}/acknowledge", {"note": "the cleaner"}))
    assert len(said) == 2
    wire = said[-1].wire()
    assert (wire["kind"], wire["id"], wire["update"], wire["note"]) == ("anomaly", number, True, "the cleaner")
    assert said[-1].position > said[0].position
    # Nobody is to hear of it from now on, but those who list it.
    over = house.clock.now + HOUR
    done(house.post(f"/anomalies/{number}/snooze", {"until": over}))
    done(house.post(f"/anomalies/{number}/acknowledge", {}))
    assert len(said) == 4
    for each, what in zip(said[2:], ("snoozed", "acknowledged"), strict=True):
        wire = each.wire()
        assert (wire["kind"], wire["location"], wire["id"]) == ("attention", name, number)
        assert (wire["change"], wire["snoozed_until"]) == (what, iso(over))
    form = {"start": 0, "stop": 60, "locations": [name, "floor-*"]}
    mute = done(house.post("/mutes", form), 201)["id"]
    assert house.delete(f"/mutes/{mute}").status_code == 204
    assert len(said) == 8
    told = [(each.location, each.id, each.data["change"]) for each in said[4:]]
    assert told == [(each, mute, what) for what in ("muted", "unmuted") for each in (name, "floor-*")]
    done(house.post(f"/anomalies/{number}/snooze", {"until": None}))
    assert len(said) == 9
    assert said[-1].kind == "anomaly"
    end()


def test_an_event_in_a_muted_time_is_stored_and_heard_when_it_outlasts_it(
    house: Api, heard: list[EventMessage]
) -> None:
    name = door(house)
    form = {"locations": [f"{name}*"], "start": NOW, "stop": NOW + 2 * MINUTE, "note": "The cleaners."}
    mute = done(house.post("/mutes", form), 201)
    assert (mute["created_by"], mute["note"], mute["until"]) == ("anybody", "The cleaners.", None)
    assert mute in done(house.get("/mutes"))["items"]
    number = alarm(house, name, 0)["id"]
    alarm(house, name, 1)
    assert unheard(house, name) == (0, [True])
    assert done(house.get(f"/locations/{name}/anomalies", params={"muted": False}))["items"] == []
    assert heard == []
    alarm(house, name, 2)
    assert unheard(house, name) == (1, [False])
    until(lambda: heard)
    assert [(each.id, each.wire()["update"]) for each in heard] == [(number, False)]
    alarm(house, name, 60)
    assert house.request("DELETE", f"/mutes/{mute['id']}").status_code == 204
    problem(house.request("DELETE", f"/mutes/{mute['id']}"), 404, "mute-not-found")


def test_a_weekly_mute_comes_again_by_the_clock_of_the_location(house: Api) -> None:
    """10 to 12 on Sundays in London, where the clock changes on 29 March 2026."""
    name = door(house, time_zone="Europe/London")
    sunday = NOW - DAY + 10 * HOUR
    form = {"locations": [name], "start": sunday, "stop": sunday + 2 * HOUR, "weekly": True}
    done(house.post("/mutes", form | {"until": sunday + 40 * DAY}), 201)
    now = house.clock.now
    house.clock.now = NOW + 60 * DAY
    expected = {
        sunday - 7 * DAY + HOUR: False,
        sunday + DAY: False,
        sunday + 21 * DAY + HOUR: True,
        sunday + 28 * DAY - HOUR / 2: True,
        sunday + 28 * DAY + 1.5 * HOUR: False,
        sunday + 42 * DAY - HOUR / 2: False,
    }
    for time in expected:
        house.observe(name, [time], [1])
    house.clock.now = now
    assert unheard(house, name) == (4, list(expected.values()))


@pytest.mark.parametrize(
    ("form", "field", "says"),
    [
        ({"start": 60, "stop": 0}, "stop", "before"),
        ({"start": 0, "stop": 8 * DAY, "weekly": True}, "stop", "a week at most"),
        ({"start": 0, "stop": 60, "until": DAY}, "until", "weekly"),
        ({"start": 0, "stop": 60, "weekly": True, "until": 30}, "until", "before the end"),
        ({"start": 0, "stop": 60, "locations": []}, "locations", "at least"),
        ({"start": 0, "stop": 60, "locations": ["*"]}, "locations[0]", ""),
        ({"start": 0, "stop": 60, "note": "x" * 2001}, "note", "2000"),
        ({"start": 0}, "stop", "missing"),
        ({"start": 0, "stop": 60, "week": True}, "week", ""),
    ],
)
def test_what_is_no_mute_is_refused(house: Api, form: dict[str, Any], field: str, says: str) -> None:
    before = done(house.get("/mutes"))
    errors = problem(house.post("/mutes", form), 422)["errors"]
    assert errors[0]["field"] == field
    assert says in errors[0]["message"]
    assert done(house.get("/mutes")) == before


def test_an_event_ends_when_nothing_can_continue_it(house: Api, heard: list[EventMessage]) -> None:
    name = door(house)
    now, house.clock.now = house.clock.now, NOW + MINUTE
    number = alarm(house, name, 0)["id"]
    until(lambda: heard)
    for minutes, ended in ((3.9, False), (4.1, True), (5.0, True)):
        house.clock.now = NOW + minutes * MINUTE
        end_events(house.ctx, find_location(house.ctx, name), NOW + MINUTE)
        assert done(house.get(f"/anomalies/{number}"))["ended"] is ended
    until(lambda: len(heard) == 2)
    assert [(each.wire()["update"], each.wire()["ended"]) for each in heard] == [(False, False), (True, True)]
    house.clock.now = now
    late = alarm(house, name, 1)
    assert (late["id"], late["ended"]) == (number, True), "what comes late continues it"

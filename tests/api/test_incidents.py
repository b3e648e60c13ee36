"""One incident is one event, whatever posts and in whatever order it came in: the cases, on SQLite and PostgreSQL."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from tests.api.house import DAY, HOUR, NOW, Api, done, open_house
from tests.support.databases import Databases
from tidemap.events.messages import EventMessage
from tidemap.schemas.common import iso, parse_time

MINUTE = 60.0
NIGHT = NOW + 2 * HOUR
"""02:00 of the night after the history."""
Order = Callable[[list[Any]], list[Any]]


@pytest.fixture(scope="module")
def house(databases: Databases, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Api]:
    """A site on a database of either kind, at noon of the day after the night in question."""
    with databases.migrated() as url, open_house(tmp_path_factory.mktemp("house"), url) as house:
        house.clock.now = NOW + DAY / 2
        yield house


def door(house: Api, **settings: Any) -> str:
    """A door with six weeks of being closed at night, and a model of them."""
    form = {"interval_s": MINUTE, "estimator": "calendar", "order": 3, "time_zone": "UTC", **settings}
    name = house.location(**form)
    time = NOW - 42 * DAY + 10 * MINUTE * np.arange(42 * 144)
    hour = time // HOUR % 24
    house.observe(name, time, ((hour >= 8) & (hour < 20)).astype(int))
    house.update(name)
    return name


def events(house: Api, name: str) -> list[dict[str, Any]]:
    """What is listed of a location."""
    return list(done(house.get(f"/locations/{name}/anomalies"))["items"])


def bounds(found: list[dict[str, Any]]) -> list[tuple[float, float]]:
    """In minutes since 02:00, in order of time."""
    times = [[(parse_time(each[end]) - NIGHT) / MINUTE for end in ("start", "stop")] for each in found]
    return sorted((start, stop) for start, stop in times)


def detected(house: Api, name: str) -> list[dict[str, Any]]:
    """What a search of the night finds."""
    form = {"start": NIGHT - HOUR, "stop": NIGHT + 8 * HOUR}
    return list(done(house.post(f"/locations/{name}/anomalies/detect", form))["items"])


def post_minutes(house: Api, name: str, minutes: list[tuple[float, int]], **how: Any) -> list[list[dict[str, Any]]]:
    """Post readings (minute since 02:00, state) one by one; of each post the events."""
    return [house.observe(name, [NIGHT + MINUTE * n], [s], **how)["anomalies"] for n, s in minutes]


def test_case_1_consecutive_posts_are_one_event(house: Api, heard: list[EventMessage]) -> None:
    name = door(house)
    answers = post_minutes(house, name, [(n, 1) for n in range(11)])
    ((event,),) = (events(house, name),)
    assert bounds([event]) == [(0, 11)]
    assert [[each["id"] for each in answer] for answer in answers] == [[event["id"]]] * 11
    assert answers[-1] == [event]
    assert [message.wire()["update"] for message in heard] == [False] + [True] * 10
    assert [message.id for message in heard] == [event["id"]] * 11
    assert heard[-1].wire()["stop"] == event["stop"] == iso(NIGHT + 11 * MINUTE)
    assert heard[-1].wire()["joined"] == []
    assert bounds(detected(house, name)) == [(0, 11)]


def test_case_2_samples_without_a_reading_do_not_split_an_event(house: Api) -> None:
    name = door(house)
    time = NIGHT + MINUTE * np.arange(30) - (np.arange(30) % 3 == 2)
    (event,) = house.observe(name, time, np.ones(30, int))["anomalies"]
    assert bounds(events(house, name)) == bounds([event]) == bounds(detected(house, name)) == [(0, 29)]


@pytest.mark.parametrize(("gap_s", "expected"), [(None, [(0, 11), (14, 19)]), (600, [(0, 19)])])
def test_case_3_a_gap_of_event_gap_s_ends_an_event(
    house: Api, gap_s: float | None, expected: list[tuple[float, float]]
) -> None:
    name = door(house, event_gap_s=gap_s)
    states = [1] * 11 + [0] * 3 + [1] * 5
    post_minutes(house, name, list(enumerate(states)))
    assert bounds(events(house, name)) == bounds(detected(house, name)) == expected


def shuffled(minutes: list[Any]) -> list[Any]:
    return [minutes[i] for i in np.random.default_rng(5).permutation(len(minutes))]


def test_case_4_posts_in_any_order_make_the_same_event(house: Api) -> None:
    minutes = [(n, 1) for n in range(11)]
    orders: list[Order] = [lambda each: each[::-1], lambda each: each[::2] + each[1::2], shuffled]
    expected = None
    for order in orders:
        name = door(house)
        post_minutes(house, name, order(minutes))
        (event,) = events(house, name)
        shown = {key: event[key] for key in event.keys() - {"id", "change", "location", "probability"}}
        expected = expected or shown
        assert bounds([event]) == bounds(detected(house, name)) == [(0, 11)]
        assert shown == expected
        assert done(house.get(f"/locations/{name}"))["open_anomalies"] == 1


def test_case_4_two_robots_that_post_in_turn(house: Api, heard: list[EventMessage]) -> None:
    name = door(house)
    for n in range(11):
        for second, robot in ((0, "ann"), (20, "bob")):
            house.observe(name, [NIGHT + MINUTE * n + second], [1], params={"source": robot})
    assert bounds(events(house, name)) == [(0, 11)]
    # What changes nothing is not published.
    assert [message.wire()["update"] for message in heard] == [False] + [True] * 10


def test_late_data_join_two_events_into_the_older(house: Api, heard: list[EventMessage]) -> None:
    name = door(house)
    post_minutes(house, name, [(n, 1) for n in range(3)])
    post_minutes(house, name, [(n, 1) for n in range(8, 11)])
    older, younger = (event["id"] for event in events(house, name))
    done(house.post(f"/anomalies/{younger}/acknowledge", {"note": "seen"}))
    post_minutes(house, name, [(5, 1)])
    assert (heard[-1].id, heard[-1].wire()["joined"], heard[-1].wire()["update"]) == (older, [younger], True)
    (event,) = events(house, name)
    assert (event["id"], bounds([event]), event["note"]) == (older, [(0, 11)], "seen")
    shown = done(house.get(f"/anomalies/{younger}"))
    assert shown == done(house.get(f"/anomalies/{older}")) == event | {"reasons": shown["reasons"]}
    assert done(house.post(f"/anomalies/{younger}/acknowledge", {"note": "again"}))["id"] == older
    assert heard[-1].wire()["note"] == "again"
    assert events(house, name)[0]["note"] == "again"


def test_case_5_a_door_that_swings_is_one_event_with_both_parts(house: Api) -> None:
    shape = [20, 20, 6]
    grid = {"frame": "map", "origin": [0, 0, 0], "resolution_m": 0.1, "shape": shape}
    name = house.location(kind="grid3d", interval_s=MINUTE, estimator="static", grid=grid)
    closed = [int(np.ravel_multi_index((5, y, z), shape)) for y in range(5, 14) for z in range(5)]
    opened = [int(np.ravel_multi_index((x, 5, z), shape)) for x in range(6, 15) for z in range(5)]
    assert len(closed) == len(opened) == 45
    house.look(name, *((NOW - DAY + MINUTE * n, closed, opened) for n in range(100)))
    house.update(name)
    swung = (NIGHT, opened, closed)
    (event,) = house.look(name, swung)["anomalies"]
    assert event["cells_total"] == 90
    assert event["parts"] == {"occupied": sorted(opened), "free": sorted(closed)}
    (again,) = house.look(name, (NIGHT + MINUTE, opened, closed))["anomalies"]
    assert (again["id"], bounds([again])) == (event["id"], [(0, 2)])
    (found,) = detected(house, name)
    (listed,) = events(house, name)
    same = ("start", "stop", "cells", "bbox", "observed", "parts", "surprise", "confidence", "rule", "revision")
    assert {key: found[key] for key in same} == {key: listed[key] for key in same}


def test_a_cursor_stays_a_resume_point_while_an_event_grows(house: Api) -> None:
    name, other = door(house), door(house)
    post_minutes(house, name, [(0, 1)])
    ((first,), (second,)) = (events(house, name), post_minutes(house, other, [(0, 1)])[0])
    page = f"/anomalies?after={first['id'] - 1}"
    held = house.get(page)
    post_minutes(house, name, [(1, 1)])
    again = house.get(page, headers={"If-None-Match": held.headers["etag"]})
    assert [event["id"] for event in done(again)["items"]] == [first["id"], second["id"]]
    assert [event["id"] for event in done(house.get(f"/anomalies?after={first['id']}"))["items"]] == [second["id"]]
    assert bounds([done(house.get(f"/anomalies/{first['id']}"))]) == [(0, 2)]


def test_an_event_gives_its_reasons(house: Api) -> None:
    """Seen open once before at that hour of that weekday, three weeks ago; closed otherwise."""
    name = door(house)
    house.observe(name, [NIGHT - 21 * DAY + 5 * MINUTE], [1])
    (event,) = post_minutes(house, name, [(7, 1)])[0]
    why = done(house.get(f"/anomalies/{event['id']}"))["reasons"]
    assert why["last_like_this"] == iso(NIGHT - 21 * DAY + 5 * MINUTE)
    assert (why["cell"], why["observed"], why["samples"]) == (0, 1, 6 * 6 + 1)
    assert why["usual"] == pytest.approx(1 / 37)
    assert why["expected"] == pytest.approx(1 - event["surprise"], abs=1e-6)


def test_reasons_are_those_of_the_local_clock(house: Api) -> None:
    """The hours of a week ago begin where the wall's clock showed the same, also across daylight saving."""
    name = house.location(interval_s=MINUTE, estimator="static", time_zone="Europe/London")
    night = parse_time("2026-02-21T02:00:00Z")
    house.observe(name, night + MINUTE * np.arange(60), np.zeros(60, int))
    house.update(name)
    (event,) = house.observe(name, [parse_time("2026-02-28T02:59:00Z")], [1])["anomalies"]
    why = done(house.get(f"/anomalies/{event['id']}"))["reasons"]
    assert (why["usual"], why["samples"], why["last_like_this"]) == (0.0, 60, None)


@pytest.mark.parametrize("rule", ["surprise", "paper"])
def test_a_confidence_is_found_that_gives_few_enough_events(house: Api, rule: str) -> None:
    """What the answer says of each confidence is what a search by it finds."""
    name = house.location(estimator="static")
    chance = np.random.default_rng(1)
    states = chance.random(24 * 28) < 0.05
    house.observe(name, NOW - 28 * DAY + HOUR * np.arange(24 * 28), states.astype(int))
    house.update(name)
    few, many = (
        done(house.get(f"/locations/{name}/confidence", params={"false_alarms_per_week": n, "rule": rule}))
        for n in (0, 1000)
    )
    assert few["weeks"] == pytest.approx(4, rel=0.02)
    assert (many["confidence"], many["reached"]) == (0.5, True)
    assert few["rates"] == many["rates"]
    for rate in few["rates"]:
        form = {"start": few["start"], "stop": few["stop"], "confidence": rate["confidence"], "rule": rule}
        found = done(house.post(f"/locations/{name}/anomalies/detect", form))["items"]
        assert rate["events"] == len(found)
        assert rate["per_week"] == pytest.approx(len(found) / few["weeks"])
        assert rate["low"] <= rate["per_week"] < rate["high"]
    assert few["reached"] == any(rate["events"] == 0 for rate in few["rates"])
    assert few["reached"] == (rule == "surprise")


def test_a_rate_is_bounded_as_poisson_rates_are(house: Api) -> None:
    """No event in four weeks: with 95 % fewer than 3 in all of them, as exp(-3) is .05."""
    name = house.location(estimator="static")
    house.observe(name, NOW - 28 * DAY + HOUR * np.arange(24 * 28), np.zeros(24 * 28, int))
    house.update(name)
    found = done(house.get(f"/locations/{name}/confidence"))
    assert {rate["events"] for rate in found["rates"]} == {0}
    assert found["rates"][0]["high"] * found["weeks"] == pytest.approx(-np.log(0.05))
    assert (found["rule"], found["confidence"], found["rates"][0]["low"]) == ("surprise", 0.5, 0.0)

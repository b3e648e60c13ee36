"""Anomalies: listed by cursor, searched in the history, acknowledged."""

from typing import Any

import numpy as np
import pytest

from tests.api.house import DAY, HOUR, NOW, Api, done, fortnight, problem

ANSWERED = {
    "id",
    "location",
    "start",
    "stop",
    "cells",
    "cells_total",
    "bbox",
    "observed",
    "probability",
    "surprise",
    "confidence",
    "rule",
    "revision",
}


@pytest.fixture
def watched(api: Api) -> str:
    """A door with a model; opening it at night is an anomaly."""
    return open_door(api)


def open_door(api: Api) -> str:
    name = api.location(estimator="fft", order=3, confidence=0.75)
    api.observe(name, *fortnight())
    api.update(name)
    return name


def surprise(api: Api, name: str, count: int = 1) -> list[int]:
    """Open the door in this many nights; the ids of the events."""
    nights = [NOW - (2 * i + 1) * 4 * HOUR for i in range(count)]
    closed = [time for time in nights if (time // HOUR) % 24 < 9 or (time // HOUR) % 24 >= 17]
    events = [event for time in closed for event in api.observe(name, [time + 1], [1])["anomalies"]]
    return [event["id"] for event in events]


def ids(page: dict[str, Any]) -> list[int]:
    return [event["id"] for event in page["items"]]


def walk(api: Api, path: str, limit: int, **query: Any) -> list[int]:
    """All ids, page by page."""
    found: list[int] = []
    after: str | None = None
    while True:
        page = done(api.get(path, params={"limit": limit, **query, **({"after": after} if after else {})}))
        assert set(page) == {"items", "next"}
        assert len(page["items"]) <= limit
        found += ids(page)
        after = page["next"]
        if after is None:
            return found
        assert len(page["items"]) == limit


def test_events_are_listed_oldest_first(api: Api, watched: str) -> None:
    made = surprise(api, watched, 8)
    assert len(made) >= 4
    page = done(api.get(f"/locations/{watched}/anomalies"))
    assert (ids(page), page["next"]) == (made, None)
    assert made == sorted(made)
    assert all(set(event) >= ANSWERED for event in page["items"])
    for limit in (1, 2, 3, len(made), 1000):
        assert walk(api, f"/locations/{watched}/anomalies", limit) == made


def test_the_list_of_all_places_holds_those_of_each(api: Api, watched: str) -> None:
    other = open_door(api)
    made = surprise(api, watched, 3) + surprise(api, other, 3)
    everywhere = walk(api, "/anomalies", 2)
    assert everywhere == sorted(set(everywhere))
    assert set(made) <= set(everywhere)
    here = done(api.get(f"/locations/{other}/anomalies"))["items"]
    assert {event["location"] for event in here} == {other}


def test_after_is_a_resume_point(api: Api, watched: str) -> None:
    first = surprise(api, watched, 4)
    assert ids(done(api.get(f"/anomalies?after={first[-1]}"))) == []
    then = surprise(api, open_door(api), 4)
    assert ids(done(api.get(f"/anomalies?after={first[-1]}"))) == then
    assert ids(done(api.get(f"/anomalies?after={first[-1]}&limit=1"))) == then[:1]
    assert ids(done(api.get("/anomalies?after=999999999999999999"))) == []
    for event in first:
        assert all(each > event for each in ids(done(api.get(f"/anomalies?after={event}"))))


def test_filters(api: Api, watched: str) -> None:
    made = surprise(api, watched, 8)
    path = f"/locations/{watched}/anomalies"
    events = {event["id"]: event for event in done(api.get(path))["items"]}

    for level in (0.0, 0.8, 0.9, 1.0):
        expected = [each for each in made if events[each]["surprise"] >= level]
        assert walk(api, path, 2, min_surprise=level) == expected

    # Times overlap [start, stop): an event that only touches them is not in it.
    one = events[made[1]]
    assert made[1] in ids(done(api.get(path, params={"start": one["start"], "stop": one["stop"]})))
    assert made[1] not in ids(done(api.get(path, params={"stop": one["start"]})))
    assert made[1] not in ids(done(api.get(path, params={"start": one["stop"]})))
    assert ids(done(api.get(path, params={"start": 0, "stop": NOW + DAY}))) == made

    done(api.post(f"/anomalies/{made[0]}/acknowledge"))
    assert ids(done(api.get(f"{path}?acknowledged=true"))) == made[:1]
    assert walk(api, path, 2, acknowledged="false") == made[1:]


def test_a_page_that_is_held_already_is_not_sent_again(api: Api, watched: str) -> None:
    made = surprise(api, watched, 3)
    path = f"/locations/{watched}/anomalies"
    first = api.get(path)
    held = {"If-None-Match": first.headers["etag"]}
    again = api.get(path, headers=held)
    assert (again.status_code, again.content) == (304, b"")
    done(api.post(f"/anomalies/{made[0]}/acknowledge", {"note": "the cleaner"}))
    changed = api.get(path, headers=held)
    assert changed.status_code == 200
    assert changed.json()["items"][0]["note"] == "the cleaner"
    held = {"If-None-Match": changed.headers["etag"]}
    api.observe(watched, [NOW + 1], [1])
    assert len(done(api.get(path, headers=held))["items"]) == len(made) + 1


def test_an_operator_acknowledges_an_event(api: Api, watched: str) -> None:
    (event,) = surprise(api, watched, 1)
    assert api.facts(watched)["open_anomalies"] == 1
    api.clock.now = NOW + 60
    answer = done(api.post(f"/anomalies/{event}/acknowledge", {"note": "Ein Handwerker, ganz früh."}))
    assert (answer["id"], answer["acknowledged_by"], answer["note"]) == (event, "anybody", "Ein Handwerker, ganz früh.")
    assert answer["acknowledged_at"] == "2026-03-02T00:01:00Z"
    assert done(api.get(f"/locations/{watched}/anomalies"))["items"] == [answer]
    assert api.facts(watched)["open_anomalies"] == 0
    (entry,) = done(api.get("/audit?limit=1"))["items"]
    assert (entry["action"], entry["target"], entry["time"]) == (
        "POST /anomalies/{anomaly_id}/acknowledge",
        f"/anomalies/{event}/acknowledge",
        answer["acknowledged_at"],
    )
    again = done(api.post(f"/anomalies/{event}/acknowledge"))
    assert (again["acknowledged_by"], again["note"]) == ("anybody", None)


class TestDetect:
    """POST /locations/{name}/anomalies/detect"""

    def search(self, api: Api, name: str, **form: Any) -> list[dict[str, Any]]:
        asked = {"start": NOW - 14 * DAY, "stop": NOW, **form}
        answer = done(api.post(f"/locations/{name}/anomalies/detect", asked))
        assert answer["revision"] == api.facts(name)["revision"]
        return list(answer["items"])

    @pytest.fixture
    def noisy(self, api: Api) -> tuple[str, np.ndarray[Any, Any], np.ndarray[Any, Any]]:
        name = api.location(estimator="fft", order=3, confidence=0.75)
        time, state = fortnight()
        flipped = state ^ (np.random.default_rng(7).random(len(state)) < 0.08)
        api.observe(name, time, flipped)
        api.update(name)
        return name, time, flipped

    @pytest.mark.parametrize("rule", ["surprise", "paper"])
    @pytest.mark.parametrize("confidence", [0.6, 0.75, 0.9])
    def test_events_are_the_samples_that_the_rule_marks(
        self, api: Api, noisy: tuple[str, Any, Any], rule: str, confidence: float
    ) -> None:
        name, time, state = noisy
        predicted = done(api.post(f"/locations/{name}/predict", {"time": time.tolist()}))
        p = np.array(predicted["probability"][0])
        marked = np.abs(p - state) > confidence if rule == "surprise" else (p > confidence) != state
        events = self.search(api, name, rule=rule, confidence=confidence)
        covered = np.zeros(len(time), bool)
        for event in events:
            assert (event["rule"], event["confidence"], event["id"]) == (rule, confidence, None)
            start, stop = (
                np.datetime64(event[edge][:-1]).astype("datetime64[s]").astype(float) for edge in ("start", "stop")
            )
            inside = (time >= start) & (time < stop)
            assert (state[inside] == event["observed"]).all()
            assert event["surprise"] == pytest.approx(np.abs(p - state)[inside].max(), abs=1e-5)
            assert event["probability"] == pytest.approx(p[inside].mean(), abs=1e-5)
            assert not covered[inside].any()
            covered |= inside
        np.testing.assert_array_equal(covered, marked)

    def test_nothing_is_stored(self, api: Api, noisy: tuple[str, Any, Any]) -> None:
        before = api.everything()
        assert self.search(api, noisy[0], confidence=0.6)
        assert api.everything() == before

    def test_the_locations_confidence_and_the_rule_surprise_unless_said(self, api: Api, noisy: Any) -> None:
        assert self.search(api, noisy[0]) == self.search(api, noisy[0], confidence=0.75, rule="surprise")

    def test_a_shorter_range_finds_fewer(self, api: Api, noisy: tuple[str, Any, Any]) -> None:
        every = self.search(api, noisy[0], confidence=0.6)
        later = self.search(api, noisy[0], confidence=0.6, start=NOW - 7 * DAY)
        assert 0 < len(later) < len(every)
        assert all(event["stop"] > "2026-02-23T00:00:00Z" for event in later)
        assert self.search(api, noisy[0], start=NOW, stop=NOW) == []
        assert self.search(api, noisy[0], start=-6e10, stop=-5e10) == []
        assert self.search(api, noisy[0], confidence=0.6, start=-6e10, stop=6e10) == every

    def test_another_order_and_estimator(self, api: Api, noisy: tuple[str, Any, Any]) -> None:
        static = self.search(api, noisy[0], confidence=0.6, estimator="static")
        assert static == self.search(api, noisy[0], confidence=0.6, order=0)
        assert static != self.search(api, noisy[0], confidence=0.6, order=3)


class TestCells:
    """Events of a grid: neighbouring cells of one kind form one event."""

    @pytest.fixture
    def empty_room(self, api: Api) -> str:
        name = api.lab(estimator="static", confidence=0.75)
        api.look(name, *((NOW - DAY + i * HOUR, [], list(range(24))) for i in range(20)))
        api.update(name)
        return name

    def test_neighbours_form_one_event(self, api: Api, empty_room: str) -> None:
        # [0,0,0] and [1,1,1] touch at a corner, [3,2,1] touches neither.
        answer = api.look(empty_room, (NOW, [[0, 0, 0], [1, 1, 1], [3, 2, 1]], [[0, 1, 0]]))
        first, second = answer["anomalies"]
        assert (first["cells"], second["cells"]) == ([0, 9], [23])
        assert first["bbox"] == [10, 20, 0, 11, 21, 1]
        assert second["bbox"] == [11.5, 21, 0.5, 12, 21.5, 1]
        assert (first["observed"], first["surprise"], first["probability"]) == (
            1,
            pytest.approx(1 - 0.5 / 21),
            pytest.approx(0.5 / 21),
        )
        assert done(api.get(f"/locations/{empty_room}/anomalies"))["items"] == [first, second]

    def test_small_events_can_be_left_out(self, api: Api, empty_room: str) -> None:
        done(api.patch(f"/locations/{empty_room}", {"min_cells": 2}))
        answer = api.look(empty_room, (NOW, [[0, 0, 0], [1, 1, 1], [3, 2, 1]], []))
        assert [event["cells"] for event in answer["anomalies"]] == [[0, 9]]

    def test_cells_that_were_never_seen_surprise_nobody(self, api: Api) -> None:
        name = api.lab(estimator="static", confidence=0.75)
        api.look(name, (NOW - DAY, [], [0]))
        api.update(name)
        assert api.look(name, (NOW, [1, 2, 3], []))["anomalies"] == []

    def test_detect_finds_them_in_the_history(self, api: Api, empty_room: str) -> None:
        api.look(empty_room, (NOW, [0, 9, 23], []), (NOW + HOUR / 2, [0], []))
        form = {"start": NOW - DAY, "stop": NOW + DAY}
        found = done(api.post(f"/locations/{empty_room}/anomalies/detect", form))["items"]
        assert [event["cells"] for event in found] == [[0, 9], [23]]


WIDE = 200
BLOCK = [i * WIDE + j for i in range(20, 120) for j in range(20, 170)]
CALM = [i * WIDE + j for i in range(0, 18, 3) for j in range(0, 30, 3)]
"""60 that were never occupied."""
SOMETIMES = [i * WIDE + j for i in range(150, 195, 3) for j in range(0, 18, 3)]
"""90 that once were, as those of the block."""


@pytest.fixture(scope="module")
def answer(api: Api) -> Any:
    grid = {"resolution_m": 0.1, "shape": [WIDE, WIDE]}
    name = api.location(kind="grid2d", grid=grid, estimator="static", confidence=0.75)
    every = set(range(WIDE**2))
    once = {*BLOCK, *SOMETIMES}
    api.look(name, (NOW - 10 * HOUR, sorted(once), sorted(every - once)))
    for i in range(1, 10):
        api.look(name, (NOW - i * HOUR, [], sorted(every)))
    api.update(name)
    return api.look(name, (NOW, [*BLOCK, *CALM, *SOMETIMES], []))


class TestMany:
    """What is listed is bounded, what is stored is not."""

    def test_the_answer_to_a_post_lists_the_most_surprising(self, answer: Any) -> None:
        events = answer["anomalies"]
        assert (len(events), answer["anomalies_total"]) == (100, 151)
        assert sum(event["surprise"] > 0.9 for event in events) == 60
        assert len([event for event in events if event["cells_total"] > 1]) == 1
        assert [event["id"] for event in events] == sorted(event["id"] for event in events)

    def test_an_event_is_listed_with_its_first_cells_and_alone_with_all(self, api: Api, answer: Any) -> None:
        (block,) = [event for event in answer["anomalies"] if event["cells_total"] > 1]
        assert (block["cells"], block["cells_total"]) == (BLOCK[:10_000], 15_000)
        path = f"/locations/{block['location']}/anomalies"
        assert block in done(api.get(path, params={"limit": 1000}))["items"]
        alone = done(api.get(f"/anomalies/{block['id']}"))
        assert alone == {**block, "cells": BLOCK, "reasons": alone["reasons"]}
        assert alone["reasons"]["cell"] in BLOCK

    def test_all_are_stored(self, api: Api, answer: Any) -> None:
        name = answer["anomalies"][0]["location"]
        assert len(done(api.get(f"/locations/{name}/anomalies?limit=1000"))["items"]) == 151

    def test_an_unknown_one(self, api: Api) -> None:
        problem(api.get("/anomalies/12345678"), 404, "anomaly-not-found")


@pytest.mark.parametrize("path", ["/anomalies", "/locations/{}/anomalies"])
@pytest.mark.parametrize(
    ("query", "field"),
    [
        ("after=x", "after"),
        ("after=-1", "after"),
        ("after=1.5", "after"),
        ("after=" + "9" * 30, "after"),
        ("after=%00", "after"),
        ("limit=0", "limit"),
        ("limit=100000", "limit"),
        ("limit=-1", "limit"),
        ("limit=ten", "limit"),
        ("start=yesterday", "start"),
        ("start=2026-03-01T00:00:00", "start"),
        ("stop=nan", "stop"),
        ("stop=1e300", "stop"),
        ("start=10&stop=9", "stop"),
        ("min_surprise=2", "min_surprise"),
        ("min_surprise=nan", "min_surprise"),
        ("acknowledged=perhaps", "acknowledged"),
    ],
)
def test_wrong_questions(api: Api, watched: str, path: str, query: str, field: str) -> None:
    found = problem(api.get(path.format(watched) + "?" + query), 422)
    assert [each["field"] for each in found["errors"]] == [field]

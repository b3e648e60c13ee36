"""/locations: made, found, changed, renamed, listed, deleted."""

from datetime import datetime

import numpy as np
import pytest

from tests.api.house import GRID, HOUR, NOW, Api, done, fortnight, problem

ANSWERED = {"observations", "first_time", "last_time", "revision", "updated_at", "accuracy"}


def test_a_new_location_shows_its_settings_and_what_is_known_of_it(api: Api) -> None:
    form = {
        "name": "office-door",
        "kind": "state",
        "interval_s": 60,
        "time_zone": "Europe/London",
        "epoch": "2026-01-01T00:00:00+01:00",
        "estimator": "fft",
        "order": 7,
        "confidence": 0.8,
        "missing": "hold",
        "hold_s": 600,
        "retention": 86400 * 30,
        "calendar": "GB-SCT",
        "pose": {"frame": "building", "position": [1.5, -2.0, 0.0]},
    }
    answer = api.post("/locations", form)
    made = done(answer, 201)
    assert answer.headers["location"] == "/api/v1/locations/office-door"
    assert {name: made[name] for name in form if name != "epoch"} == {k: v for k, v in form.items() if k != "epoch"}
    assert made["epoch"] == "2025-12-31T23:00:00Z"
    assert made["created_at"] == "2026-03-02T00:00:00Z"
    assert {name: made[name] for name in ANSWERED} == {
        "observations": 0,
        "first_time": None,
        "last_time": None,
        "revision": 0,
        "updated_at": None,
        "accuracy": None,
    }
    assert done(api.get("/locations/office-door")) == made


def test_what_is_left_out_has_the_documented_defaults(api: Api) -> None:
    made = api.facts(api.location())
    defaults = {
        "estimator": "auto",
        "order": "auto",
        "confidence": 0.9,
        "missing": "mask",
        "epoch": "1970-01-01T00:00:00Z",
        "calendar": None,
        "pose": None,
    }
    assert {name: made[name] for name in defaults} == defaults


@pytest.mark.parametrize(("kind", "shape"), [("grid2d", [3, 4]), ("grid3d", [3, 4, 5]), ("grid2d", [3, 4, 1])])
def test_a_grid_shows_its_geometry(api: Api, kind: str, shape: list[int]) -> None:
    grid = {**GRID, "shape": shape}
    made = api.facts(api.location(kind=kind, grid=grid))
    assert (made["grid"], made["shape"], made["kind"]) == (grid, shape, kind)


@pytest.mark.parametrize("name", ["a", "A.b_c-9", "x" * 128, "0", "CON", "state", "a..b"])
def test_names_that_are_taken_as_they_are(api: Api, name: str) -> None:
    assert done(api.get(f"/locations/{api.location(name=name)}"))["name"] == name
    assert api.delete(f"/locations/{name}").status_code == 204


def test_a_name_is_given_once(api: Api) -> None:
    name = api.location()
    found = problem(api.post("/locations", {"name": name, "interval_s": 1}), 409, "name-taken")
    assert name in found["detail"]


def test_counters_follow_the_observations_and_the_model(api: Api) -> None:
    name = api.location(estimator="fft", order=2)
    time, state = fortnight()
    api.observe(name, time[100:], state[100:])
    api.observe(name, time[:50], state[:50])
    known = api.facts(name)
    assert known["observations"] == len(time) - 50
    assert (seconds(known["first_time"]), seconds(known["last_time"])) == (time[0], time[-1])
    assert (known["revision"], known["updated_at"], known["accuracy"]) == (0, None, None)

    api.clock.now = NOW + 5
    api.update(name)
    known = api.facts(name)
    assert (known["revision"], known["updated_at"]) == (1, "2026-03-02T00:00:05Z")
    assert 0.5 < known["accuracy"] <= 1


def test_settings_can_be_changed_one_by_one(api: Api) -> None:
    name = api.location()
    before = api.facts(name)
    changes = [
        {"time_zone": "Europe/Berlin"},
        {"estimator": "static"},
        {"order": 9},
        {"order": "auto"},
        {"confidence": 0.6},
        {"hold_s": 60},
        {"missing": "hold"},
        {"retention": 1e6},
        {"retention": None},
        {"calendar": "DE-BY"},
        {"calendar": None},
        {"pose": {"frame": "map", "position": [0.0, 1.0, 2.0]}},
        {"pose": None},
        {"min_cells": 4},
        {},
    ]
    for change in changes:
        before |= change
        assert done(api.patch(f"/locations/{name}", change)) == before
    assert api.facts(name) == before


@pytest.mark.parametrize("field", ["interval_s", "epoch", "kind", "grid", "revision", "colour"])
def test_the_time_base_and_the_grid_stay(api: Api, field: str) -> None:
    name = api.location()
    before = api.facts(name)
    found = problem(api.patch(f"/locations/{name}", {field: before.get(field, 1)}), 422)
    assert [each["field"] for each in found["errors"]] == [field]
    assert api.facts(name) == before


def test_a_change_that_contradicts_itself_changes_nothing(api: Api) -> None:
    name = api.location()
    before = api.facts(name)
    found = problem(api.patch(f"/locations/{name}", {"missing": "hold", "confidence": 0.6}), 422)
    assert found["errors"][0]["field"] == "hold_s"
    assert api.facts(name) == before


def test_a_renamed_location_keeps_all_that_is_its_own(api: Api) -> None:
    old = api.location(estimator="fft", order=2)
    api.observe(old, *fortnight())
    job = api.update(old)
    api.observe(old, [NOW - 30], [1])
    before, events = api.facts(old), done(api.get(f"/locations/{old}/anomalies"))["items"]
    new = api.name("renamed")

    assert done(api.patch(f"/locations/{old}", {"name": new})) == {**before, "name": new}
    problem(api.get(f"/locations/{old}"), 404, "location-not-found")
    assert api.facts(new) == {**before, "name": new}
    assert done(api.get(f"/jobs/{job['id']}"))["location"] == new
    assert done(api.get(f"/locations/{new}/anomalies"))["items"] == [{**each, "location": new} for each in events]
    assert done(api.get(f"/locations/{new}/state"))["revision"] == 1
    api.location(name=old)
    assert api.facts(old)["observations"] == 0


def test_a_name_cannot_be_taken_from_another(api: Api) -> None:
    first, second = api.location(), api.location()
    problem(api.patch(f"/locations/{first}", {"name": second}), 409, "name-taken")
    assert api.facts(first)["name"] == first
    assert done(api.patch(f"/locations/{first}", {"name": first}))["name"] == first


def test_a_deleted_location_is_gone_with_all_that_was_its_own(api: Api) -> None:
    name = api.location(estimator="fft", order=2)
    api.observe(name, *fortnight())
    job = api.update(name)
    api.observe(name, [NOW - 30], [1])
    events = done(api.get(f"/locations/{name}/anomalies"))["items"]
    assert events

    answer = api.delete(f"/locations/{name}")
    assert (answer.status_code, answer.content) == (204, b"")
    problem(api.delete(f"/locations/{name}"), 404, "location-not-found")
    problem(api.get(f"/jobs/{job['id']}"), 404, "job-not-found")
    problem(api.post(f"/anomalies/{events[0]['id']}/acknowledge"), 404, "anomaly-not-found")
    assert name not in {each["name"] for each in done(api.get("/locations?limit=1000"))["items"]}


def test_a_location_made_in_the_location_of_a_deleted_one_knows_nothing_of_it(api: Api) -> None:
    name = api.location(estimator="fft", order=2)
    time, state = fortnight()
    api.observe(name, time, state)
    api.update(name)
    asked = f"/locations/{name}/state?time={NOW}"
    old = api.get(asked)
    assert sum(done(api.get(f"/locations/{name}/series"))["observed"]) == state.sum()

    api.delete(f"/locations/{name}")
    api.location(name=name, estimator="fft", order=2)
    problem(api.get(f"/locations/{name}/model"), 409, "no-model")
    api.observe(name, time, 1 - state)
    assert done(api.get(f"/locations/{name}/series"))["observed"] == (1 - state).tolist()
    api.update(name)
    new = api.get(asked, headers={"If-None-Match": old.headers["etag"]})
    assert new.status_code == 200
    assert new.json()["probability"] != old.json()["probability"]


def test_locations_are_listed_by_name_page_by_page(api: Api) -> None:
    made = {api.location(name=f"listed-{i:02}") for i in range(7)}
    listed, after = [], None
    while True:
        page = done(api.get("/locations", params={"limit": 3, **({"after": after} if after else {})}))
        assert set(page) == {"items", "next"}
        assert len(page["items"]) <= 3
        listed += [each["name"] for each in page["items"]]
        after = page["next"]
        if after is None:
            break
    assert listed == sorted(listed)
    assert made <= set(listed)
    assert len(listed) == len(set(listed))


def seconds(text: str) -> float:
    assert text.endswith("Z")
    return datetime.fromisoformat(text).timestamp()


def test_times_come_out_as_iso_8601_in_utc(api: Api) -> None:
    name = api.location(epoch=-HOUR / 2)
    assert api.facts(name)["epoch"] == "1969-12-31T23:30:00Z"


def test_a_public_holiday_is_predicted_as_a_sunday(api: Api) -> None:
    name = api.location(estimator="calendar", interval_s=3600, time_zone="Europe/London", calendar="GB-ENG")
    hours = np.arange(6 * 7 * 24)
    time = NOW - HOUR * (hours.size - hours)
    opened = (hours % 24 >= 9) & (hours % 24 < 17) & (hours // 24 % 7 < 5)
    api.observe(name, time.tolist(), opened.astype(int).tolist())
    api.update(name)
    good_friday, a_friday = "2026-04-03T12:00:00Z", "2026-04-10T12:00:00Z"
    answer = done(api.post(f"/locations/{name}/predict", {"time": [good_friday, a_friday], "given": "model"}))
    holiday, working = answer["probability"][0]
    assert holiday < 0.1 < 0.9 < working

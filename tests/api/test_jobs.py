"""/locations/{name}/update and /jobs: asked for, followed, listed, cancelled."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event

import pytest

from tests.api.house import DAY, NOW, Api, done, fortnight, open_house, problem
from tests.support.waiting import WAIT_S, until
from tidemap.services import jobs

ANSWERED = {"id", "kind", "location", "state", "progress", "error", "result"}


@pytest.fixture
def seen(api: Api) -> str:
    """A door with a fortnight of history and no model."""
    name = api.location(estimator="fft", order=3)
    api.observe(name, *fortnight())
    return name


def test_waiting_answers_with_the_finished_job(api: Api, seen: str) -> None:
    answer = api.post(f"/locations/{seen}/update?wait=60", {})
    job = done(answer, 200)
    assert set(job) >= ANSWERED
    assert answer.headers["location"] == f"/api/v1/jobs/{job['id']}"
    assert (job["kind"], job["location"], job["state"], job["progress"]) == ("update", seen, "done", 1)
    assert job["error"] is None
    assert (job["result"]["revision"], job["result"]["estimator"], job["result"]["order"]) == (1, "fft", 3)
    assert 0.5 < job["result"]["accuracy"] <= 1
    assert done(api.get(f"/jobs/{job['id']}")) == job


@pytest.mark.parametrize("body", [None, {}], ids=["no-body", "empty-form"])
def test_not_waiting_answers_at_once_and_the_job_is_followed(api: Api, seen: str, body: object) -> None:
    job = done(api.post(f"/locations/{seen}/update", body), 202)
    assert job["state"] in ("queued", "running")
    states = [job["state"]]
    deadline = time.monotonic() + WAIT_S
    while job["state"] not in ("done", "failed") and time.monotonic() < deadline:
        job = done(api.get(f"/jobs/{job['id']}"))
        assert 0 <= job["progress"] <= 1
        states.append(job["state"])
    assert states[-1] == "done"
    assert api.facts(seen)["revision"] == 1


def test_what_the_form_says_goes_before_the_locations_settings(api: Api, seen: str) -> None:
    result = api.update(seen, estimator="static")["result"]
    assert (result["estimator"], result["order"]) == ("static", 0)
    assert api.update(seen, order=5)["result"]["order"] == 5
    result = api.update(seen, estimator="auto", order="auto")["result"]
    assert result["selection"]["estimator"] == result["estimator"] != "static"
    assert api.facts(seen)["revision"] == 3


def test_a_window_is_fitted_to_what_lies_in_it(api: Api, seen: str) -> None:
    api.update(seen, start=NOW - 7 * DAY, stop="2026-03-01T00:00:00Z")
    model = done(api.get(f"/locations/{seen}/model"))
    assert (model["start"], model["stop"]) == ("2026-02-23T00:00:00Z", "2026-03-01T00:00:00Z")
    assert model["samples"] == 6 * 24


def test_nothing_to_fit_fails_the_job_and_says_why(api: Api) -> None:
    job = done(api.post(f"/locations/{api.location()}/update?wait=60", {}), 200)
    assert (job["state"], job["result"]) == ("failed", None)
    assert "no observations" in job["error"]


def test_a_window_without_observations_fails_the_job(api: Api, seen: str) -> None:
    job = done(api.post(f"/locations/{seen}/update?wait=60", {"start": 0, "stop": 10}), 200)
    assert job["state"] == "failed"
    assert "widen" in job["error"]
    assert api.facts(seen)["revision"] == 0


def test_jobs_are_listed_newest_first_page_by_page(api: Api, seen: str) -> None:
    made = [api.update(seen)["id"] for _ in range(5)]
    listed: list[int] = []
    after: str | None = None
    while True:
        page = done(api.get("/jobs", params={"limit": 2, **({"after": after} if after else {})}))
        assert set(page) == {"items", "next"}
        listed += [job["id"] for job in page["items"]]
        after = page["next"]
        if after is None:
            break
    assert listed == sorted(set(listed), reverse=True)
    assert listed[:5] == made[::-1]


@contextmanager
def held_up(api: Api, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Within, no job is begun."""
    go_on = Event()
    run_job = jobs.run_job

    def wait_first(*arguments: object) -> None:
        go_on.wait(WAIT_S)
        run_job(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr("tidemap.workers.updater.run_job", wait_first)
    try:
        yield
    finally:
        go_on.set()


def test_a_queued_job_can_be_cancelled_and_no_other(api: Api, seen: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with held_up(api, monkeypatch):
        running = done(api.post(f"/locations/{seen}/update", {}), 202)
        queued = done(api.post(f"/locations/{seen}/update", {}), 202)
        until(lambda: done(api.get(f"/jobs/{running['id']}"))["state"] == "running")
        cancelled = done(api.delete(f"/jobs/{queued['id']}"))
        assert cancelled["state"] == "cancelled"
        audited = done(api.get("/audit?limit=1"))
        assert audited["items"][0]["action"] == "DELETE /jobs/{job_id}"
        assert audited["items"][0]["target"] == f"/jobs/{queued['id']}"
        problem(api.delete(f"/jobs/{queued['id']}"), 409, "job-finished")
        assert done(api.get("/audit?limit=1")) == audited, "what was refused is not in the log"
        problem(api.delete(f"/jobs/{running['id']}"), 409, "job-finished")
    until(lambda: done(api.get(f"/jobs/{running['id']}"))["state"] == "done")
    problem(api.delete(f"/jobs/{running['id']}"), 409, "job-finished")
    assert done(api.get(f"/jobs/{queued['id']}"))["state"] == "cancelled"
    assert api.facts(seen)["revision"] == 1


def test_waiting_ends_when_its_time_is_up(api: Api, seen: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with held_up(api, monkeypatch):
        began = time.monotonic()
        job = done(api.post(f"/locations/{seen}/update?wait=0.3", {}), 202)
        assert time.monotonic() - began >= 0.3
        assert job["state"] in ("queued", "running"), "it ended no sooner than what it waited for"
    until(lambda: done(api.get(f"/jobs/{job['id']}"))["state"] == "done")


def test_a_job_that_runs_can_be_waited_for(api: Api, seen: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with held_up(api, monkeypatch):
        job = done(api.post(f"/locations/{seen}/update", {}), 202)
        assert done(api.get(f"/jobs/{job['id']}?wait=0.1"))["state"] != "done"
    assert done(api.get(f"/jobs/{job['id']}?wait=30"))["state"] == "done"
    assert done(api.get(f"/jobs/{job['id']}?wait=30"))["state"] == "done"
    problem(api.get("/jobs/99999?wait=1"), 404, "job-not-found")
    problem(api.get(f"/jobs/{job['id']}?wait=301"), 422)


def test_a_location_may_be_deleted_under_its_job(api: Api, seen: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with held_up(api, monkeypatch):
        job = done(api.post(f"/locations/{seen}/update", {}), 202)
        until(lambda: done(api.get(f"/jobs/{job['id']}"))["state"] == "running")
        assert api.delete(f"/locations/{seen}").status_code == 204
    problem(api.get(f"/jobs/{job['id']}"), 404, "job-not-found")
    other = api.location(estimator="static")
    api.observe(other, [NOW - 10], [1])
    assert api.update(other)["result"]["revision"] == 1


def test_a_job_that_was_cut_short_runs_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with open_house(tmp_path) as api:
        name = api.location(estimator="fft", order=1)
        api.observe(name, *fortnight())
        monkeypatch.setattr("tidemap.workers.updater.run_job", lambda *_: None)
        job = done(api.post(f"/locations/{name}/update?wait=0.2", {}), 202)
        assert done(api.get(f"/jobs/{job['id']}"))["state"] == "running"
    monkeypatch.undo()
    with open_house(tmp_path) as api:
        until(lambda: done(api.get(f"/jobs/{job['id']}"))["state"] == "done")
        assert api.facts(name)["revision"] == 1


def test_the_updater_needs_no_asking(tmp_path: Path) -> None:
    with open_house(tmp_path, updater=True, updater_interval_s=0.05, update_rest_s=60.0) as api:
        name = api.location(estimator="fft", order=2)
        time_, state = fortnight()
        api.observe(name, time_[:-24], state[:-24])
        until(lambda: api.facts(name)["revision"] == 1)
        api.observe(name, time_[-24:-23], state[-24:-23])
        api.clock.now = NOW + 120
        time.sleep(0.2)
        assert api.facts(name)["revision"] == 1, "one more measurement is no reason"
        api.clock.now = NOW
        api.observe(name, time_, state)
        time.sleep(0.2)
        assert api.facts(name)["revision"] == 1, "it rests a while after an update"
        api.clock.now = NOW + 61
        until(lambda: api.facts(name)["revision"] == 2)

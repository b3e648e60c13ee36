"""/healthz, /readyz, /metrics and the API's own documents."""

import re
from pathlib import Path

import httpx
import pytest
from sqlalchemy import text

from tests.api.house import NOW, Api, Http, done, open_house, problem
from tests.support.databases import PostgresDatabases
from tests.support.postgres import Postgres
from tests.support.waiting import until
from tidemap.api.main import create_app
from tidemap.storage.engine import open_writer
from tidemap.version import __version__
from tidemap.workers.worker import Worker

MISSED = '/locations/{name}",status="404"} 1.0'


@pytest.fixture
def own(tmp_path: Path) -> object:
    with open_house(tmp_path) as api:
        yield api


def root(api: Api, path: str, **how: object) -> httpx.Response:
    return api.http.request("GET", path, **how)


def test_a_process_that_answers_lives(own: Api) -> None:
    assert root(own, "/healthz").json() == {"status": "ok"}


def test_a_site_in_order_is_ready(own: Api) -> None:
    answer = root(own, "/readyz")
    assert (answer.status_code, answer.json()) == (200, {"status": "ok", "problems": []})


def test_it_is_not_ready_while_a_part_is_dead(own: Api) -> None:
    site = create_app(own.ctx, {"updater": lambda: False})
    answer = Http(own.http.portal, site).request("GET", "/readyz")
    assert answer.status_code == 503
    assert any("updater" in each for each in answer.json()["problems"])
    assert 'tidemap_worker_up{worker="updater"} 0.0' in Http(own.http.portal, site).request("GET", "/metrics").text


def test_where_several_share_a_database_its_relay_has_to_be_at_work(
    tmp_path: Path, postgres: Postgres, monkeypatch: pytest.MonkeyPatch
) -> None:
    with PostgresDatabases(postgres).migrated() as url, open_house(tmp_path, url) as api:
        assert root(api, "/readyz").status_code == 200
        lines = root(api, "/metrics").text.splitlines()
        for worker in ("relay", "updater", "compactor", "watcher", "webhooks", "watch"):
            assert f'tidemap_worker_up{{worker="{worker}"}} 1.0' in lines
        monkeypatch.setattr(Worker, "alive", lambda worker: worker._name != "relay-listener")
        assert root(api, "/readyz").json()["problems"] == ["the relay is not running"]
        assert 'tidemap_worker_up{worker="relay"} 0.0' in root(api, "/metrics").text


def test_it_is_not_ready_on_another_schema(own: Api) -> None:
    engine = open_writer(own.ctx.settings.url)
    with engine.begin() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
    engine.dispose()
    answer = root(own, "/readyz")
    assert answer.status_code == 503
    assert "9999" in answer.json()["problems"][0]
    assert root(own, "/healthz").status_code == 200


def test_metrics_are_for_prometheus(own: Api) -> None:
    name = own.location()
    own.observe(name, [NOW - 1, NOW], [0, 1])
    own.get("/locations/nowhere")
    answer = root(own, "/metrics")
    assert answer.headers["content-type"].startswith("text/plain")
    lines = answer.text.splitlines()
    assert "tidemap_measurements_total 2.0" in lines
    assert 'tidemap_events_total{kind="observation"} 1.0' in lines
    assert "tidemap_commit_queue 0.0" in lines

    assert any(line.startswith("tidemap_request_seconds_count{") and MISSED in line for line in lines)


def test_metrics_follow_the_conventions(own: Api) -> None:
    name = own.location()
    own.observe(name, [NOW - 1, NOW], [0, 1])
    assert "tidemap_compaction_backlog_measurements 2.0" in root(own, "/metrics").text
    own.update(name)
    own.http.request("GET", f"/locations/{name}")
    own.get(f"/locations/{name}")
    said = root(own, "/metrics").text
    assert "_created" not in said
    for beginning in (
        "process_resident_memory_bytes ",
        f'tidemap_build_info{{version="{__version__}"}} 1.0',
        "tidemap_locations 1.0",
        "tidemap_database_bytes ",
        f'tidemap_location_last_observation_timestamp_seconds{{location="{name}"}} 1.7724096e+09',
        f'tidemap_location_last_update_timestamp_seconds{{location="{name}"}} ',
        'tidemap_jobs_total{state="done"} 1.0',
        'tidemap_request_seconds_count{method="GET",route="/locations/{name}",status="200"} 1.0',
        'tidemap_request_seconds_count{method="GET",route="/api/v1/locations/{name}",status="200"} 1.0',
    ):
        assert f"\n{beginning}" in said, beginning
    count = re.search(r"tidemap_commit_seconds_count (\d+)", said)
    assert count is not None
    assert int(count[1]) > 0


def test_few_locations_are_named(own: Api, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tidemap.services.monitoring.MAX_NAMED_LOCATIONS", 2)
    names = [own.location() for _ in range(3)]
    for name in names:
        own.observe(name, [NOW], [1])
    said = root(own, "/metrics").text
    assert [f'location="{name}"' in said for name in names] == [True, True, False]
    assert "tidemap_locations 3.0" in said


def test_health_answers_head(own: Api) -> None:
    assert [own.http.request("HEAD", path).status_code for path in ("/healthz", "/readyz")] == [200, 200]


def test_every_answer_names_its_request(own: Api) -> None:
    given = root(own, "/healthz", headers={"X-Request-ID": "proxy-7.1"})
    assert given.headers["x-request-id"] == "proxy-7.1"
    own_ids = {root(own, "/nothing", headers={"X-Request-ID": bad}).headers["x-request-id"] for bad in ("", "a b")}
    assert len(own_ids) == 2
    assert all(len(each) == 16 for each in own_ids)


def test_metrics_say_where_the_background_work_is_done(own: Api) -> None:
    until(lambda: "tidemap_background 1.0" in root(own, "/metrics").text.splitlines())
    site = create_app(own.ctx)
    assert "tidemap_background 0.0" in Http(own.http.portal, site).request("GET", "/metrics").text.splitlines()


def test_invented_methods_and_paths_make_no_new_series(own: Api) -> None:
    for i in range(3):
        own.http.request(f"FOO{i}", f"/api/v1/locations/x{i}")
        own.http.request("GET", f"/nothing-{i}")
    said = root(own, "/metrics").text
    assert "FOO" not in said
    assert "nothing-" not in said
    assert "x1" not in said


def test_with_keys_metrics_need_an_operator_and_health_nobody(own: Api) -> None:
    secrets: dict[str, str] = {}
    for role in ("admin", "robot", "operator"):
        how = {"headers": {"Authorization": f"Bearer {secrets['admin']}"}} if secrets else {}
        secrets[role] = done(own.post("/keys", {"name": role, "role": role}, **how), 201)["key"]
    assert root(own, "/healthz").status_code == root(own, "/readyz").status_code == 200
    assert root(own, "/metrics").status_code == 401
    for role, status in (("robot", 403), ("operator", 200), ("admin", 200)):
        assert root(own, "/metrics", headers={"Authorization": f"Bearer {secrets[role]}"}).status_code == status


@pytest.mark.parametrize("path", ["/nothing", "/api", "/api/v1", "/api/v1/nothing", "/api/v2/locations"])
def test_addresses_that_are_not_there(own: Api, path: str) -> None:
    answer = root(own, path)
    assert answer.status_code == 404
    assert answer.headers["content-type"] == "application/problem+json"
    assert "/api/docs" in answer.json()["detail"]


def test_the_documentation_is_served(own: Api) -> None:
    page = root(own, "/api/docs")
    assert page.status_code == 200
    assert "/api/v1/openapi.json" in page.text
    problem(own.get("/locations/none"), 404, "location-not-found")

"""Polls: who asks again for a list that is as it was is answered without reading it, and never who may not ask."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.api.house import HOUR, NOW, Api, Http, done, open_house, problem
from tests.api.routes import bearer
from tests.support.waiting import until
from tidemap.api.main import create_app
from tidemap.services.acknowledging import acknowledge
from tidemap.services.anomalies import Anomaly, EventQuery, list_events
from tidemap.services.context import Context, open_context
from tidemap.services.keys import delete_key
from tidemap.settings import Settings

PATH = "/locations/door/anomalies"
COUNTED = 'tidemap_request_seconds_count{method="GET",route="/api/v1/locations/{name}/anomalies",status="304"}'


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory, databases: Any) -> Iterator[Api]:
    """A site of either kind, with a door that surprised once: event 1."""
    with databases.migrated() as url, open_house(tmp_path_factory.mktemp("polls"), url) as api:
        api.location(name="door", estimator="static", event_gap_s=0)
        api.observe("door", [NOW - HOUR * ago for ago in range(1, 21)], [0] * 20)
        api.update("door")
        api.observe("door", [NOW - 10], [1])
        yield api


@pytest.fixture
def reads(monkeypatch: pytest.MonkeyPatch) -> list[EventQuery]:
    """What lists are read for."""
    asked: list[EventQuery] = []

    def noted(ctx: Context, query: EventQuery) -> list[Anomaly]:
        asked.append(query)
        return list_events(ctx, query)

    monkeypatch.setattr("tidemap.api.routers.anomalies.list_events", noted)
    return asked


@contextmanager
def another(api: Api) -> Iterator[Context]:
    """Another process on the same database."""
    with open_context(Settings(database_url=api.ctx.settings.url, updater=False), api.clock) as ctx:
        yield ctx


def ask(api: Api, etag: str, **how: Any) -> httpx.Response:
    """Ask whether a version stands, as one client does all the time."""
    return api.get(PATH, headers={"If-None-Match": etag, **how.pop("headers", {})}, **how)


def settled(api: Api, reads: list[EventQuery], **headers: str) -> str:
    """The version that is answered without reading: of PostgreSQL once all that was published has been heard."""
    etag: str = api.get(PATH, headers=headers).headers["etag"]

    def known() -> bool:
        ask(api, etag, headers=headers)
        before = len(reads)
        assert ask(api, etag, headers=headers).status_code == 304
        return len(reads) == before

    until(known)
    return etag


def key(api: Api, name: str, **form: Any) -> dict[str, Any]:
    made: dict[str, Any] = done(api.post("/keys", {"name": name, "role": "operator", **form}), 201)
    return made


def test_what_is_as_it_was_is_not_read_again(house: Api, reads: list[EventQuery]) -> None:
    etag = settled(house, reads)
    read = ask(house, f"W/{etag}")
    before, counted = len(reads), metric(house)
    house.observe("door", [NOW - 5], [0])
    answer = ask(house, f'"another", W/{etag}', headers={"X-Request-ID": "mine"})
    assert (answer.status_code, answer.content, len(reads)) == (304, b"", before)
    assert metric(house) == counted + 1
    assert dict(answer.headers) == {**read.headers, "x-request-id": "mine"}
    assert answer.headers["cache-control"] == "private, no-cache"
    assert answer.headers["vary"] == "Accept, Authorization, Cookie"
    assert ask(house, '"another"').status_code == 200
    assert house.get(PATH).status_code == 200


def metric(api: Api) -> float:
    lines = api.http.request("GET", "/metrics").text.splitlines()
    return sum(float(line.split()[-1]) for line in lines if line.startswith(COUNTED))


def test_what_changed_is_seen_at_once(house: Api, reads: list[EventQuery]) -> None:
    etag = settled(house, reads)
    house.observe("door", [NOW - 3 * HOUR + 60], [1])
    assert len(done(ask(house, etag))["items"]) == 2
    etag = settled(house, reads)
    done(house.post("/anomalies/1/acknowledge", {"note": "the cleaner"}))
    assert done(ask(house, etag))["items"][0]["note"] == "the cleaner"
    etag = settled(house, reads)
    done(house.patch("/locations/door", {"name": "gate"}))
    problem(ask(house, etag), 404, "location-not-found")
    done(house.patch("/locations/gate", {"name": "door"}))


def test_what_another_process_changed_is_seen(house: Api, reads: list[EventQuery]) -> None:
    etag = settled(house, reads)
    with another(house) as ctx:
        acknowledge(ctx, 1, "ann", "seen elsewhere")
        if house.ctx.store.changes.exact:
            assert ask(house, etag).status_code == 200
        else:
            # Nobody relays what that process does: it says nothing, and is seen all the same.
            until(lambda: ask(house, etag).status_code == 200)


def test_who_may_not_ask_is_not_answered(house: Api, reads: list[EventQuery]) -> None:
    etag = settled(house, reads)
    problem(ask(house, etag, headers={"Host": "evil.example"}), 403, "other-site")
    boss = key(house, "boss", role="admin")
    problem(ask(house, etag), 401, "unauthorized")
    admin = bearer(boss["key"])

    brief = done(house.post("/keys", {"name": "b", "role": "operator", "expires_at": NOW + 60}, headers=admin), 201)
    here = done(house.post("/keys", {"name": "h", "role": "operator", "locations": ["d*"]}, headers=admin), 201)
    there = done(house.post("/keys", {"name": "t", "role": "operator", "locations": ["x"]}, headers=admin), 201)
    for each in (brief, here, boss):
        settled(house, reads, **bearer(each["key"]))
    problem(ask(house, etag, headers=bearer(there["key"])), 403, "out-of-scope")
    problem(ask(house, etag, headers=bearer("tm_wrong")), 401, "unauthorized")

    house.clock.now = NOW + 59
    assert ask(house, etag, headers=bearer(brief["key"])).status_code == 304
    house.clock.now = NOW + 60
    problem(ask(house, etag, headers=bearer(brief["key"])), 401, "unauthorized")
    house.clock.now = NOW

    assert house.request("DELETE", f"/keys/{here['id']}", headers=admin).status_code == 204
    problem(ask(house, etag, headers=bearer(here["key"])), 401, "unauthorized")
    with another(house) as ctx:
        for each in (brief, there, boss):
            delete_key(ctx, each["id"])
    if house.ctx.store.changes.exact:
        problem(ask(house, etag, headers=admin), 401, "unauthorized")
    else:
        until(lambda: ask(house, etag, headers=admin).status_code == 401)


def test_polls_are_held_to_the_rate_of_their_key(tmp_path: Path, reads: list[EventQuery]) -> None:
    with open_house(tmp_path, requests_per_s=0.001, requests_burst=6) as api:
        api.location(name="door")
        who = bearer(key(api, "poller", role="admin")["key"])
        etag = api.get(PATH, headers=who).headers["etag"]
        answers = [ask(api, etag, headers=who).status_code for _ in range(6)]
        assert (answers, len(reads)) == ([304] * 5 + [429], 2)


def test_a_session_is_looked_up_every_time(tmp_path: Path, reads: list[EventQuery]) -> None:
    with open_house(tmp_path) as api:
        api.location(name="door")
        secret = key(api, "boss", role="admin")["key"]
        assert api.http.request("POST", "/login", data={"key": secret}).status_code == 303
        etag = api.get(PATH).headers["etag"]
        assert [ask(api, etag).status_code for _ in range(3)] == [304] * 3
        assert len(reads) == 4
        api.clock.now = NOW + 13 * HOUR
        problem(ask(api, etag), 401, "unauthorized")


def test_where_nothing_is_heard_of_others_lists_are_read(house: Api, reads: list[EventQuery]) -> None:
    deaf = Api(house.ctx, Http(house.http.portal, create_app(house.ctx, {"relay": lambda: False})), house.clock)
    etag = deaf.get(PATH).headers["etag"]
    assert [ask(deaf, etag).status_code for _ in range(3)] == [304] * 3
    assert len(reads) == (2 if house.ctx.store.changes.exact else 4)

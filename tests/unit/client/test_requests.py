"""What the client asks for, byte by byte, and how it reads pages and jobs."""

import asyncio
import json
from urllib.parse import parse_qs, urlsplit

import pytest

from tests.unit.client.scripted import Said, scripted
from tidemap.client import AsyncClient, Client
from tidemap.client import encoding as client_encoding

EVENT = {
    "id": 1,
    "location": "lab",
    "start": "1970-01-01T00:00:00Z",
    "stop": "1970-01-01T00:05:00Z",
    "cells": [1],
    "bbox": None,
    "observed": 1,
    "probability": 0.01,
    "surprise": 0.99,
    "confidence": 0.9,
    "rule": "surprise",
    "revision": 1,
}
JOB = {
    "id": 4,
    "kind": "update",
    "location": "lab",
    "state": "running",
    "progress": 0.5,
    "created_at": "1970-01-01T00:00:00Z",
}


def event(number: int, **changes: object) -> dict[str, object]:
    return EVENT | {"id": number} | changes


def page(*events: dict[str, object], after: str | None = None) -> Said:
    return Said(body={"items": list(events), "next": after})


def test_the_key_goes_with_every_request_and_the_secret_into_no_repr() -> None:
    with (
        scripted(Said(body={"items": [], "next": None})) as script,
        Client(script.url, key="tm_secret") as client,
    ):
        client.locations()
        assert "tm_secret" not in repr(client) + repr(client.location("lab"))
    assert script.received[0].headers["Authorization"] == "Bearer tm_secret"
    assert script.received[0].path == "/api/v1/locations"


def test_names_are_quoted_in_paths() -> None:
    with (
        scripted(Said(404, {})) as script,
        Client(script.url) as client,
        pytest.raises(Exception, match="404"),
    ):
        client.location("../keys?x").get()
    assert script.received[0].path == "/api/v1/locations/..%2Fkeys%3Fx"


def test_anomalies_go_through_all_pages_and_only_as_far_as_they_are_read() -> None:
    with (
        scripted(page(event(1), event(2), after="2"), page(event(3))) as script,
        Client(script.url) as client,
    ):
        found = client.location("lab").anomalies(after=0, min_surprise=0.5)
        assert next(found).id == 1
        assert len(script.received) == 1
        assert [each.id for each in found] == [2, 3]
    queries = [parse_qs(urlsplit(request.path).query) for request in script.received]
    assert queries == [{"after": ["0"], "min_surprise": ["0.5"]}, {"after": ["2"], "min_surprise": ["0.5"]}]


def test_anomalies_of_the_asynchronous_client() -> None:
    async def read(url: str) -> list[int | None]:
        async with AsyncClient(url) as client:
            return [each.id async for each in client.anomalies()]

    with scripted(page(event(1), after="1"), page(event(2))) as script:
        assert asyncio.run(read(script.url)) == [1, 2]


def test_batches_merge_into_one_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client_encoding.batches, "__defaults__", (2,))

    def stored(accepted: int, first: str, last: str, *events: dict[str, object]) -> Said:
        times = {"first_time": f"1970-01-0{first}T00:00:00Z", "last_time": f"1970-01-0{last}T00:00:00Z"}
        told = {"anomalies": events, "anomalies_total": 100 * len(events)}
        return Said(201, {"accepted": accepted, "duplicate": False, **told, "revision": accepted} | times)

    longer = event(1, stop="1970-01-01T09:00:00Z")
    answers = stored(2, "1", "2", event(1)), stored(1, "3", "4", longer, event(2))
    with scripted(*answers) as script, Client(script.url) as client:
        accepted = client.location("lab").observe([1, 2, 3], [0, 1, 0], source="spot")
    assert len(script.received) == 2
    assert len({request.headers["Idempotency-Key"] for request in script.received}) == 2
    assert all(request.path.endswith("?source=spot") for request in script.received)
    assert (accepted.accepted, accepted.first_time, accepted.last_time) == (3, 0, 3 * 86400)
    assert [(each.id, each.stop) for each in accepted.anomalies] == [(1, 9 * 3600), (2, 300)]
    assert (accepted.revision, accepted.anomalies_total) == (1, 300)


def test_update_asks_until_the_job_has_ended() -> None:
    answers = (
        Said(202, JOB),
        Said(body=JOB | {"state": "running"}),
        Said(body=JOB | {"state": "done", "progress": 1}),
    )
    with scripted(*answers) as script, Client(script.url) as client:
        assert client.location("lab").update(order=3).state == "done"
    assert [request.path.split("?")[0] for request in script.received] == [
        "/api/v1/locations/lab/update",
        "/api/v1/jobs/4",
        "/api/v1/jobs/4",
    ]
    assert json.loads(script.received[0].content) == {"order": 3}


def test_a_short_timeout_asks_for_one_job_and_lets_the_server_wait() -> None:
    late = Said(body=JOB | {"state": "done", "progress": 1}, after_s=0.5)
    with scripted(late) as script, Client(script.url, timeout_s=0.1) as client:
        assert client.location("lab").update().state == "done"
    assert len(script.received) == 1


@pytest.mark.parametrize("wait", [False, 0.3])
def test_update_waits_no_longer_than_asked(wait: float) -> None:
    with scripted(Said(202, JOB)) as script, Client(script.url) as client:
        assert client.location("lab").update(wait=wait).state == "running"
    assert len(script.received) <= 4


def test_a_deletion_names_its_time_in_unix_seconds_and_its_robot() -> None:
    with scripted(Said(body={"deleted": 3})) as script, Client(script.url) as client:
        assert client.location("lab").delete_observations(0, "1970-01-01T00:01:00Z", "spot").deleted == 3
    (request,) = script.received
    assert (request.method, request.path) == (
        "DELETE",
        "/api/v1/locations/lab/observations?start=0.0&stop=60.0&source=spot",
    )


def test_a_renamed_location_keeps_its_handle() -> None:
    location = {
        "name": "new",
        "kind": "state",
        "interval_s": 60,
        "time_zone": "UTC",
        "epoch": "1970-01-01T00:00:00Z",
        "grid": None,
        "shape": [1],
        "estimator": "auto",
        "order": "auto",
        "confidence": 0.9,
        "missing": "mask",
        "hold_s": None,
        "retention": None,
        "min_cells": 1,
        "created_at": "1970-01-01T00:00:00Z",
        "observations": 0,
        "first_time": None,
        "last_time": None,
        "revision": 0,
        "updated_at": None,
        "accuracy": None,
        "open_anomalies": 0,
    }
    with scripted(Said(body=location)) as script, Client(script.url) as client:
        door = client.location("old")
        door.patch(name="new", retention=None)
        assert door.name == "new"
        door.get()
    assert json.loads(script.received[0].content) == {"name": "new", "retention": None}
    assert script.received[1].path == "/api/v1/locations/new"

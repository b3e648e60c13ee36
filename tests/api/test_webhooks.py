"""/webhooks: made, changed, tried and listed; nothing is sent where it must not go; no secret is stored."""

import base64
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.api.house import HOUR, NOW, Api, done, open_house, problem
from tests.support.receiver import BREAK, receiving
from tests.support.waiting import until
from tidemap.settings import Settings

URL = "https://alarms.example.org/tidemap"


@pytest.fixture
def inner(tmp_path: Path) -> Iterator[Api]:
    """A site that may send to this machine."""
    with open_house(tmp_path, webhooks_private=True) as api:
        yield api


def test_a_webhook_is_made_changed_listed_and_deleted(api: Api) -> None:
    made = done(api.post("/webhooks", {"url": URL, "locations": ["hall", "floor-2-*"]}), 201)
    assert made.pop("secret").startswith("whsec_")
    assert made == {
        "id": made["id"],
        "url": URL,
        "description": "",
        "locations": ["hall", "floor-2-*"],
        "enabled": True,
        "created_at": "2026-03-02T00:00:00Z",
    }
    path = f"/webhooks/{made['id']}"
    assert done(api.get(path)) == made
    assert done(api.get("/webhooks"))["items"] == [made]
    changed = done(api.patch(path, {"locations": None, "enabled": False, "description": "pager"}))
    assert changed == {**made, "locations": None, "enabled": False, "description": "pager"}
    assert done(api.patch(path, {})) == changed
    assert done(api.get(f"{path}/deliveries")) == {"items": [], "next": None}
    assert api.delete(path).status_code == 204
    for method, gone in (("GET", path), ("DELETE", path), ("POST", f"{path}/test"), ("GET", f"{path}/deliveries")):
        problem(api.request(method, gone), 404, "webhook-not-found")
    problem(api.patch(path, {"enabled": True}), 404, "webhook-not-found")
    again = done(api.post("/webhooks", {"url": URL}), 201)
    assert again["id"] > made["id"], "a number is never given again"
    api.delete(f"/webhooks/{again['id']}")


@pytest.mark.parametrize(
    ("form", "field"),
    [
        ({}, "url"),
        ({"url": ""}, "url"),
        ({"url": 3}, "url"),
        ({"url": "alarms.example.org"}, "url"),
        ({"url": "ftp://alarms.example.org"}, "url"),
        ({"url": "http://alarms.example.org"}, "url"),
        ({"url": "https://"}, "url"),
        ({"url": "https://user:password@alarms.example.org"}, "url"),
        ({"url": "https://alarms.example.org/#part"}, "url"),
        ({"url": "https://alarms.example.org:0/"}, "url"),
        ({"url": "https://alarms.example.org:99999/"}, "url"),
        ({"url": "https://[::1"}, "url"),
        ({"url": "https://" + "a" * 2000}, "url"),
        ({"url": "https://a\0b"}, "url"),
        ({"url": "https://127.0.0.1/"}, "url"),
        ({"url": "https://10.0.0.7/"}, "url"),
        ({"url": "https://169.254.169.254/latest"}, "url"),
        ({"url": "https://[::1]/"}, "url"),
        ({"url": "https://[::ffff:192.168.1.1]/"}, "url"),
        ({"url": URL, "locations": ["*"]}, "locations[0]"),
        ({"url": URL, "description": "x" * 129}, "description"),
        ({"url": URL, "secret": "whsec_mine"}, "secret"),
    ],
)
def test_wrong_forms(api: Api, form: Any, field: str) -> None:
    found = problem(api.post("/webhooks", form), 422, "invalid-input")
    assert [each["field"] for each in found["errors"]] == [field]
    assert done(api.get("/webhooks"))["items"] == []


@pytest.mark.parametrize("form", [{"url": None}, {"enabled": None}, {"url": "https://10.0.0.1"}, {"id": 3}])
def test_wrong_changes(api: Api, form: Any) -> None:
    made = done(api.post("/webhooks", {"url": URL}), 201)
    path = f"/webhooks/{made['id']}"
    problem(api.patch(path, form), 422, "invalid-input")
    assert done(api.get(path))["url"] == URL
    api.delete(path)


def test_the_secret_is_shown_once_and_no_copy_of_the_database_holds_it(inner: Api, tmp_path: Path) -> None:
    made = done(inner.post("/webhooks", {"url": URL}), 201)
    secret = made["secret"]
    stored = b"".join(path.read_bytes() for path in tmp_path.iterdir() if path.name.startswith("tidemap.db"))
    for form in (secret.encode(), base64.b64decode(secret.removeprefix("whsec_"))):
        assert form not in stored
    key = tmp_path / "secret.key"
    assert key.stat().st_mode & 0o777 == 0o600
    assert key.read_bytes() not in stored
    assert base64.b64decode(key.read_bytes()) not in stored
    for path in ("/webhooks", f"/webhooks/{made['id']}", "/audit"):
        assert secret not in inner.get(path).text
    another = done(inner.post("/webhooks", {"url": URL}), 201)
    assert another["secret"] != secret


def test_a_damaged_key_is_reported_and_not_replaced(inner: Api, tmp_path: Path) -> None:
    for content in (b"", b"AAAA", b"not base64!"):
        (tmp_path / "secret.key").write_bytes(content)
        problem(inner.post("/webhooks", {"url": URL}), 409, "secret-file")
        assert (tmp_path / "secret.key").read_bytes() == content
    assert done(inner.get("/webhooks"))["items"] == []


def test_a_test_message_says_what_came_of_it(inner: Api) -> None:
    statuses = iter([204, 500, BREAK])
    with receiving(lambda: next(statuses)) as receiver:
        inner.clock.now = _now()
        made = done(inner.post("/webhooks", {"url": receiver.url}), 201)
        receiver.secret = made["secret"]
        path = f"/webhooks/{made['id']}/test"
        assert done(inner.post(path)) == {"delivered": True, "status": 204, "error": None}
        assert done(inner.post(path)) == {"delivered": False, "status": 500, "error": "the receiver answered 500"}
        broken = done(inner.post(path))
        assert (broken["delivered"], broken["status"]) == (False, None)
        assert broken["error"]
        assert [message["type"] for _, message in receiver.came] == ["test"] * 3
        assert len({name for name, _ in receiver.came}) == 3
    assert done(inner.post(path))["error"].startswith("ConnectError")
    assert done(inner.get(f"/webhooks/{made['id']}/deliveries"))["items"] == []


def test_a_name_that_stands_for_an_address_of_ones_own_is_not_sent_to(api: Api) -> None:
    made = done(api.post("/webhooks", {"url": "https://localhost/"}), 201)
    attempt = done(api.post(f"/webhooks/{made['id']}/test"))
    assert not attempt["delivered"]
    assert "private networks" in attempt["error"]
    api.delete(f"/webhooks/{made['id']}")


def test_an_anomaly_is_delivered_and_listed(inner: Api) -> None:
    inner.clock.now = _now()
    name = inner.location(estimator="static")
    inner.observe(name, [NOW - HOUR * ago for ago in range(1, 21)], [0] * 20)
    inner.update(name)
    with receiving() as receiver:
        made = done(inner.post("/webhooks", {"url": receiver.url}), 201)
        receiver.secret = made["secret"]
        (event,) = inner.observe(name, [NOW - 10], [1])["anomalies"]
        until(lambda: receiver.accepted)
    ((message_id, message),) = receiver.accepted
    assert message["type"] == "anomaly"
    sent = message["data"]
    assert (sent["kind"], sent["id"], sent["location"]) == ("anomaly", event["id"], name)
    assert {key: sent[key] for key in event} == event
    path = f"/webhooks/{made['id']}/deliveries"
    (listed,) = until(lambda: done(inner.get(f"{path}?state=delivered"))["items"])
    assert (listed["message_id"], listed["anomaly_id"], listed["attempts"]) == (message_id, event["id"], 1)
    assert done(inner.get(f"{path}?state=failed"))["items"] == []
    assert done(inner.post(f"{path}/{listed['id']}/retry"))["state"] == "waiting"
    problem(inner.post(f"{path}/999/retry"), 404, "delivery-not-found")
    problem(inner.get(f"{path}?state=lost"), 422, "invalid-input")
    problem(inner.get(f"{path}?after=x"), 422, "invalid-input")


def test_there_are_at_most_a_hundred(inner: Api, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tidemap.services.webhooks.MAX_WEBHOOKS", 3)
    for _ in range(3):
        done(inner.post("/webhooks", {"url": URL}), 201)
    problem(inner.post("/webhooks", {"url": URL}), 409, "too-many-webhooks")
    pages = [done(inner.get("/webhooks?limit=2"))]
    pages.append(done(inner.get(f"/webhooks?limit=2&after={pages[0]['next']}")))
    assert [len(page["items"]) for page in pages] == [2, 1]
    assert pages[1]["next"] is None


def test_the_key_lies_where_the_settings_say(tmp_path: Path) -> None:
    assert Settings(data=tmp_path).secret_path == tmp_path / "secret.key"
    assert Settings(data=tmp_path, secret_file=tmp_path / "elsewhere").secret_path == tmp_path / "elsewhere"


def _now() -> float:
    """The real time: receivers refuse what is old."""
    return time.time()

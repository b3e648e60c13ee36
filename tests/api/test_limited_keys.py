"""Keys that see some locations, that expire, that are rotated and revoked; and who changed what."""

from collections.abc import AsyncIterator, Iterator
from typing import Any

import pytest

from tests.api.house import HOUR, NOW, Api, done, open_house, problem
from tests.api.routes import IDS, ROLES, TABLE, ask, bearer
from tests.support.waiting import until

FILTERING = {"/locations", "/anomalies", "/jobs", "/events", "/mutes"}
"""Lists that show what a key may see."""
NAMES = ("door", "yard-gate")


@pytest.fixture(scope="module")
def limited(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Api, dict[str, str]]]:
    """A site with `door`, of which anomaly 1 and job 1 are, and `yard-gate`, of which 2 are; keys by role and scope."""
    with open_house(tmp_path_factory.mktemp("limited")) as api:
        for name in NAMES:
            api.location(name=name, estimator="static")
            api.observe(name, [NOW - HOUR * ago for ago in range(1, 21)], [0] * 20)
            api.update(name)
            api.observe(name, [NOW - 10], [1])
        for role in ROLES:
            api.location(name=f"spare-{role}")
        admin = bearer(done(api.post("/keys", {"name": "boss", "role": "admin"}), 201)["key"])
        secrets = {"boss": admin["Authorization"].split()[1]}
        for scope, patterns in {"here": ["door", "spare-*", "new-*"], "there": ["yard-*", "doo"]}.items():
            for role in ROLES:
                form = {"name": f"{role} {scope}", "role": role, "locations": patterns}
                made = done(api.post("/keys", form, headers=admin), 201)
                assert made["locations"] == patterns
                secrets[f"{role} {scope}"] = made["key"]
        yield api, secrets


@pytest.mark.parametrize(("method", "path", "form", "allowed"), TABLE, ids=IDS)
def test_a_key_of_other_locations_does_nothing_here(
    limited: Any, method: str, path: str, form: Any, allowed: set[str]
) -> None:
    api, secrets = limited
    for role in ROLES:
        answer = ask(api, method, path, form, role, headers=bearer(secrets[f"{role} there"]))
        if role not in allowed:
            problem(answer, 403, "forbidden")
        elif method == "GET" and path.split("?", maxsplit=1)[0] in FILTERING:
            assert answer.status_code in (200, 422)
            assert "door" not in answer.text
        elif path.split("/")[1] in ("anomalies", "jobs") or path.startswith("/mutes/"):
            problem(answer, 404)
        else:
            problem(answer, 403, "out-of-scope")


@pytest.mark.parametrize(("method", "path", "form", "allowed"), TABLE, ids=IDS)
def test_a_key_of_this_location_does_what_its_role_may(
    limited: Any, method: str, path: str, form: Any, allowed: set[str]
) -> None:
    api, secrets = limited
    for role in ROLES:
        answer = ask(api, method, path, form, role, headers=bearer(secrets[f"{role} here"]))
        named = path.split("?", maxsplit=1)[0].count("/") > 1 and not path.startswith(("/keys", "/webhooks"))
        filtering = method == "GET" and path.split("?", maxsplit=1)[0] in FILTERING
        if role in allowed and (named or filtering or path == "/mutes"):
            assert answer.status_code not in (401, 403, 500), answer.text
        else:
            problem(answer, 403)


@pytest.mark.parametrize("state", ["expired", "revoked"])
@pytest.mark.parametrize(("method", "path", "form", "allowed"), TABLE, ids=IDS)
def test_a_key_that_has_ended_opens_nothing(
    limited: Any, state: str, method: str, path: str, form: Any, allowed: set[str]
) -> None:
    api, secrets = limited
    boss = bearer(secrets["boss"])
    made = done(api.post("/keys", {"name": "brief", "role": "admin", "expires_at": NOW + 60}, headers=boss), 201)
    if state == "revoked":
        assert api.request("DELETE", f"/keys/{made['id']}", headers=boss).status_code == 204
    try:
        api.clock.now = NOW + 60
        problem(ask(api, method, path, form, "admin", headers=bearer(made["key"])), 401, "unauthorized")
    finally:
        api.clock.now = NOW


def test_lists_show_what_a_key_may_see(limited: Any) -> None:
    api, secrets = limited
    there, boss = bearer(secrets["operator there"]), bearer(secrets["boss"])
    assert [each["name"] for each in done(api.get("/locations", headers=there))["items"]] == ["yard-gate"]
    for path in ("/anomalies", "/jobs"):
        assert {each["location"] for each in done(api.get(path, headers=there))["items"]} == {"yard-gate"}
        assert {each["location"] for each in done(api.get(path, headers=boss))["items"]} == set(NAMES)
    done(api.get("/anomalies/2", headers=there))
    done(api.get("/jobs/2", headers=there))
    for odd in ("1.0", "+1", " 1", "１", "01"):
        problem(api.get(f"/anomalies/{odd}", headers=there), 404, "anomaly-not-found")


def test_a_location_is_not_renamed_to_where_its_key_does_not_reach(limited: Any) -> None:
    api, secrets = limited
    headers = bearer(secrets["admin there"])
    problem(api.request("PATCH", "/locations/yard-gate", json={"name": "roof"}, headers=headers), 403, "out-of-scope")
    for name in ("yard-2", "yard-gate"):
        before = "yard-gate" if name == "yard-2" else "yard-2"
        done(api.request("PATCH", f"/locations/{before}", json={"name": name}, headers=headers))


def test_a_key_that_posted_just_now_expires_to_the_second(limited: Any) -> None:
    api, secrets = limited
    form = {"name": "brief", "role": "admin", "expires_at": NOW + 60}
    made = done(api.post("/keys", form, headers=bearer(secrets["boss"])), 201)
    assert made["expires_at"] == "2026-03-02T00:01:00Z"
    try:
        for now, status in ((NOW + 59, 201), (NOW + 59, 201), (NOW + 60, 401), (NOW + 60, 401)):
            api.clock.now = now
            sent = {"time": [NOW - 60], "state": [0]}
            answer = api.post("/locations/door/observations", sent, headers=bearer(made["key"]))
            assert answer.status_code == status
    finally:
        api.clock.now = NOW


def test_a_rotated_key_and_the_new_one_open_for_the_overlap(limited: Any) -> None:
    api, secrets = limited
    boss = bearer(secrets["boss"])
    form = {"name": "display", "role": "operator", "locations": ["door"], "expires_at": NOW + 1000}
    old = done(api.post("/keys", form, headers=boss), 201)
    asked = "/locations/door/state"
    done(api.get(asked, headers=bearer(old["key"])))
    new = done(api.post(f"/keys/{old['id']}/rotate", {"overlap_s": 100}, headers=boss), 201)
    assert new["key"] != old["key"]
    assert {name: new[name] for name in form if name != "expires_at"} == {
        name: form[name] for name in form if name != "expires_at"
    }
    assert new["expires_at"] == old["expires_at"]
    # It asked just before: the first look may be out of date, and then a client sends it again by itself.
    first = api.get(asked, headers=bearer(old["key"]))
    if first.status_code != 200:
        problem(first, 503, "key-changed")
    try:
        for now, statuses in ((NOW + 99, (200, 200)), (NOW + 100, (401, 200)), (NOW + 1000, (401, 401))):
            api.clock.now = now
            answers = [api.get(asked, headers=bearer(each["key"])).status_code for each in (old, new)]
            assert tuple(answers) == statuses
        api.clock.now = NOW + 101
        problem(api.post(f"/keys/{old['id']}/rotate", {}, headers=boss), 404, "key-not-found")
    finally:
        api.clock.now = NOW
    problem(api.post(f"/keys/{new['id']}/rotate", {"overlap_s": -1}, headers=boss), 422)
    problem(api.post(f"/keys/{new['id']}/rotate", {"overlap_s": 1000}, headers=boss), 409, "key-ends")
    at_once = done(api.post(f"/keys/{new['id']}/rotate", {"overlap_s": 0}, headers=boss), 201)
    problem(api.get(asked, headers=bearer(new["key"])), 401)
    done(api.get(asked, headers=bearer(at_once["key"])))


def test_it_is_known_when_a_key_was_used_last(limited: Any) -> None:
    api, secrets = limited
    boss = bearer(secrets["boss"])
    made = done(api.post("/keys", {"name": "rare", "role": "operator"}, headers=boss), 201)

    def last_used() -> Any:
        return next(each for each in done(api.get("/keys", headers=boss))["items"] if each["id"] == made["id"])

    assert last_used()["last_used_at"] is None
    done(api.get("/locations", headers=bearer(made["key"])))
    assert until(lambda: last_used()["last_used_at"]) == "2026-03-02T00:00:00Z"


def test_what_is_changed_is_in_the_audit_log_with_who_changed_it(limited: Any) -> None:
    api, secrets = limited
    boss = bearer(secrets["boss"])
    made = done(api.post("/keys", {"name": "x", "role": "admin"}, headers=boss), 201)
    mine = bearer(made["key"])
    done(api.post("/locations", {"name": "attic", "interval_s": 60}, headers=mine), 201)
    done(api.request("PATCH", "/locations/attic", json={"confidence": 0.8}, headers=mine))
    problem(api.post("/locations", {"name": "attic", "interval_s": 60}, headers=mine), 409)
    done(api.post("/locations/attic/observations", {"time": [NOW - 60], "state": [1]}, headers=mine), 201)
    done(api.request("DELETE", f"/locations/attic/observations?start=0&stop={NOW}", headers=mine))
    assert api.request("DELETE", "/locations/attic", headers=mine).status_code == 204
    entries = done(api.get("/audit?limit=4", headers=boss))["items"]
    assert {(each["actor"], each["key_id"], each["time"]) for each in entries} == {
        ("x", made["id"], "2026-03-02T00:00:00Z")
    }
    assert [(each["action"], each["target"], each["detail"]) for each in reversed(entries)] == [
        ("POST /locations", "/locations", '{"name":"attic","interval_s":60}'),
        ("PATCH /locations/{name}", "/locations/attic", '{"confidence":0.8}'),
        (
            "DELETE /locations/{name}/observations",
            "/locations/attic/observations",
            f"start=0&stop={NOW}",
        ),
        ("DELETE /locations/{name}", "/locations/attic", None),
    ], "and what was refused is not"
    for secret in (made["key"], secrets["boss"]):
        assert secret not in api.get("/audit?limit=1000", headers=boss).text


def test_no_body_hides_what_was_asked_from_the_audit_log(limited: Any) -> None:
    api, secrets = limited
    boss = bearer(secrets["boss"])
    query = "start=0&stop=1"
    done(api.request("DELETE", f"/locations/door/observations?{query}", content=b"x", headers=boss))
    form = b" " * 5000 + b'{"name": "spaced", "interval_s": 60}'
    done(api.request("POST", "/locations", content=form, headers=boss | {"Content-Type": "application/json"}), 201)
    entries = done(api.get("/audit?limit=2", headers=boss))["items"]
    assert [each["detail"] for each in entries] == ['{"name":"spaced","interval_s":60}', query]


@pytest.mark.parametrize(
    "path", ["/keys/1", "/locations/door", "/webhooks/1", "/locations/door/observations?start=0&stop=1"]
)
def test_a_body_that_nobody_needs_is_not_read(limited: Any, path: str) -> None:
    api, secrets = limited
    taken = []

    async def endless() -> AsyncIterator[bytes]:
        for _ in range(200):
            taken.append(1)
            yield b"x" * 65536

    problem(api.request("DELETE", path, content=endless(), headers=bearer(secrets["robot here"])), 403)
    assert len(taken) < 200


def test_the_audit_log_is_read_page_by_page(limited: Any) -> None:
    api, secrets = limited
    boss = bearer(secrets["boss"])
    everything = [each["id"] for each in done(api.get("/audit?limit=1000", headers=boss))["items"]]
    assert everything == sorted(everything, reverse=True)
    found: list[int] = []
    after: str | None = ""
    while after is not None:
        page = done(api.get("/audit", params={"limit": 3, **({"after": after} if after else {})}, headers=boss))
        found += [each["id"] for each in page["items"]]
        after = page["next"]
    assert found == everything


@pytest.mark.parametrize(
    ("method", "path", "form", "kept"),
    [
        ("POST", "/keys", {"name": "a", "role": "robot"}, "private, no-store"),
        ("GET", "/keys", None, "private, no-store"),
        ("GET", "/locations", None, "private, no-store"),
        ("GET", "/nowhere", None, "private, no-store"),
        ("GET", "/anomalies", None, "private, no-cache"),
        ("GET", "/locations/door/state", None, "private, no-cache"),
        ("GET", "/openapi.json", None, None),
    ],
)
def test_nobody_else_may_keep_an_answer(limited: Any, method: str, path: str, form: Any, kept: str | None) -> None:
    api, secrets = limited
    answer = ask(api, method, path, form, "admin", headers=bearer(secrets["boss"]))
    assert answer.headers.get("cache-control") == kept

"""Keys and roles: who may do what on every route."""

from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.api.house import HOUR, NOW, Api, done, open_house, problem
from tests.api.routes import IDS, LOCATION, ROLES, TABLE, ask, bearer


@pytest.fixture(scope="module")
def locked(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Api, dict[str, str]]]:
    """A site with one key of each role, and their secrets."""
    with open_house(tmp_path_factory.mktemp("locked")) as api:
        api.location(name="door", estimator="static")
        for role in ROLES:
            api.location(name=f"spare-{role}")
        api.observe("door", [NOW - HOUR * ago for ago in range(1, 21)], [0] * 20)
        api.update("door")
        api.observe("door", [NOW - 10], [1])
        admin = done(api.post("/keys", {"name": "the admin", "role": "admin"}), 201)["key"]
        secrets = {"admin": admin}
        for role in ("robot", "operator"):
            form = {"name": f"the {role}", "role": role}
            secrets[role] = done(api.post("/keys", form, headers=bearer(admin)), 201)["key"]
        yield api, secrets


@pytest.mark.parametrize(("method", "path", "form", "allowed"), TABLE, ids=IDS)
def test_who_may_do_what(locked: Any, method: str, path: str, form: Any, allowed: set[str]) -> None:
    api, secrets = locked
    for role in ROLES:
        answer = ask(api, method, path, form, role, headers=bearer(secrets[role]))
        if role in allowed:
            assert answer.status_code not in (401, 403, 500), (role, answer.text)
        else:
            found = problem(answer, 403, "forbidden")
            assert role in found["detail"]


@pytest.mark.parametrize(("method", "path", "form", "allowed"), TABLE, ids=IDS)
@pytest.mark.parametrize(
    "header",
    [
        {},
        {"Authorization": "Bearer tm_wrong"},
        {"Authorization": "Bearer"},
        {"Authorization": "Basic YTpi"},
        {"Authorization": "Bearer tm_\xfc"},
        {"Cookie": "tidemap_session=1.9999999999.abc"},
        {"Cookie": "tidemap_session=..."},
    ],
    ids=["none", "wrong", "empty", "basic", "latin-1", "forged-cookie", "odd-cookie"],
)
def test_without_a_known_key_nothing_is_answered(
    locked: Any, method: str, path: str, form: Any, allowed: set[str], header: dict[str, str]
) -> None:
    api, _ = locked
    answer = ask(api, method, path, form, "robot", headers={k: v.encode("latin-1") for k, v in header.items()})
    problem(answer, 401, "unauthorized")
    assert answer.headers["www-authenticate"] == "Bearer"


@pytest.mark.parametrize(("method", "path", "form", "allowed"), TABLE, ids=IDS)
@pytest.mark.parametrize("header", [{}, {"Authorization": "Bearer tm_wrong"}], ids=["none", "wrong"])
@pytest.mark.parametrize("kind", ["application/json", "application/x-npy", "application/vnd.apache.arrow.stream"])
def test_no_body_is_read_before_the_key_is_known(
    locked: Any, method: str, path: str, form: Any, allowed: set[str], header: dict[str, str], kind: str
) -> None:
    api, _ = locked
    # A sender that was let in lately is looked up with its post: the first one after the server was closed is read.
    problem(api.post("/locations/door/observations", {"time": [NOW - 60], "state": [1]}), 401, "unauthorized")
    asked_for = []

    async def body() -> AsyncIterator[bytes]:
        asked_for.append(path)
        yield b"{}"

    headers = {**header, "Content-Type": kind}
    problem(api.request(method, path.format(role="robot"), content=body(), headers=headers), 401, "unauthorized")
    assert asked_for == []


def test_the_table_holds_every_route(locked: Any) -> None:
    api, _ = locked
    document = done(api.get("/openapi.json"))
    known = {(method.upper(), path) for path, item in document["paths"].items() for method in item}
    paths = {path for _, path in known}
    tested = set()
    for method, path, _, _ in TABLE:
        plain = f"/api/v1{path.split('?')[0]}"
        tested.add((method, plain if plain in paths else next(p for p in paths if matches(p, plain))))
    # /api/v1 routes only: health and metrics are tested with the health routes.
    assert {route for route in known if route[1].startswith("/api/v1")} <= tested


def matches(template: str, path: str) -> bool:
    parts, given = template.split("/"), path.split("/")
    return len(parts) == len(given) and all(p == g or p.startswith("{") for p, g in zip(parts, given, strict=True))


def test_a_refused_post_is_not_even_read(locked: Any) -> None:
    api, secrets = locked
    before = done(api.get("/locations/door", headers=bearer(secrets["operator"])))
    too_much = b"x" * (2**20 + 1)
    for path in ("/locations/door/observations", "/locations", "/locations/door/predict", "/keys"):
        problem(api.post(path, content=too_much, headers={"Content-Type": "application/json"}), 401)
    problem(api.post("/locations/door/observations", content=too_much, headers=bearer(secrets["operator"])), 403)
    assert done(api.get("/locations/door", headers=bearer(secrets["operator"]))) == before


def test_a_secret_is_shown_once_and_stored_nowhere(locked: Any, tmp_path: Path) -> None:
    with open_house(tmp_path) as api:
        made = done(api.post("/keys", {"name": "r2", "role": "admin"}), 201)
        unset = {"locations", "expires_at", "last_used_at"}
        assert set(made) == {"id", "name", "role", "prefix", "created_at", "key"} | unset
        assert {made[name] for name in unset} == {None}
        assert made["key"].startswith("tm_")
        assert len(made["key"]) > 40
        assert made["key"].startswith(made["prefix"])
        assert len(made["prefix"]) < 12
        (listed,) = done(api.get("/keys", headers=bearer(made["key"])))["items"]
        shown = {name: value for name, value in made.items() if name != "key"}
        assert {**listed, "last_used_at": None} == shown
        files = b"".join(path.read_bytes() for path in tmp_path.iterdir())
        assert listed["name"].encode() in files
        assert made["key"].encode() not in files
        assert made["key"][len(made["prefix"]) :].encode() not in files


def test_a_revoked_key_stops_at_once(locked: Any) -> None:
    api, secrets = locked
    admin = bearer(secrets["admin"])
    made = done(api.post("/keys", {"name": "brief", "role": "operator"}, headers=admin), 201)
    done(api.get("/locations", headers=bearer(made["key"])))
    assert api.request("DELETE", f"/keys/{made['id']}", headers=admin).status_code == 204
    problem(api.get("/locations", headers=bearer(made["key"])), 401)
    problem(api.request("DELETE", f"/keys/{made['id']}", headers=admin), 404, "key-not-found")


def post(api: Api, headers: dict[str, str]) -> Any:
    return api.post("/locations/door/observations", {"time": [NOW - 60], "state": [1]}, headers=headers)


def test_a_revoked_robot_posts_no_more_though_it_posted_just_now(locked: Any) -> None:
    api, secrets = locked
    admin = bearer(secrets["admin"])
    made = done(api.post("/keys", {"name": "brief", "role": "robot"}, headers=admin), 201)
    for _ in range(2):
        done(post(api, bearer(made["key"])), 201)
    before = done(api.get("/locations/door", headers=admin))["observations"]
    assert api.request("DELETE", f"/keys/{made['id']}", headers=admin).status_code == 204
    # SQLite gives the number of the last key again: the old secret must not stand for the new key.
    done(api.post("/keys", {"name": "brief", "role": "robot"}, headers=admin), 201)
    for _ in range(2):
        problem(post(api, bearer(made["key"])), 401, "unauthorized")
    assert done(api.get("/locations/door", headers=admin))["observations"] == before


def test_the_first_key_ends_posting_without_one(tmp_path: Path) -> None:
    with open_house(tmp_path) as api:
        done(api.post("/locations", {"name": "door", **LOCATION}), 201)
        for _ in range(2):
            done(post(api, {}), 201)
        made = done(api.post("/keys", {"name": "r2", "role": "robot"}), 201)
        for _ in range(2):
            problem(post(api, {}), 401, "unauthorized")
        done(post(api, bearer(made["key"])), 201)


def test_who_asked_just_now_may_not_ask_on_when_that_has_ended(tmp_path: Path) -> None:
    with open_house(tmp_path) as api:
        done(api.post("/locations", {"name": "door", **LOCATION}), 201)
        done(post(api, {}), 201)
        api.update("door", estimator="static")
        asked = "/locations/door/state"
        for _ in range(2):
            done(api.get(asked))
        admin = bearer(done(api.post("/keys", {"name": "boss", "role": "admin"}), 201)["key"])
        for _ in range(2):
            problem(api.get(asked), 401, "unauthorized")
        made = done(api.post("/keys", {"name": "brief", "role": "operator"}, headers=admin), 201)
        robot = done(api.post("/keys", {"name": "r2", "role": "robot"}, headers=admin), 201)
        for _ in range(2):
            done(api.get(asked, headers=bearer(made["key"])))
            problem(api.get(asked, headers=bearer(robot["key"])), 403, "forbidden")
        assert api.request("DELETE", f"/keys/{made['id']}", headers=admin).status_code == 204
        for _ in range(2):
            problem(api.get(asked, headers=bearer(made["key"])), 401, "unauthorized")


def test_keys_are_listed_page_by_page(tmp_path: Path) -> None:
    with open_house(tmp_path) as api:
        admin = bearer(done(api.post("/keys", {"name": "0", "role": "admin"}), 201)["key"])
        for number in range(1, 5):
            done(api.post("/keys", {"name": str(number), "role": "robot"}, headers=admin), 201)
        pages: list[list[str]] = []
        after: dict[str, str] | None = {}
        while after is not None:
            page = done(api.get("/keys", params={"limit": 2, **after}, headers=admin))
            pages.append([key["name"] for key in page["items"]])
            after = None if page["next"] is None else {"after": page["next"]}
        assert pages == [["0", "1"], ["2", "3"], ["4"]]
        for wrong in ({"after": "x"}, {"limit": 0}, {"limit": 1001}):
            problem(api.get("/keys", params=wrong, headers=admin), 422, "invalid-input")


def test_a_key_names_who_acknowledged(locked: Any) -> None:
    api, secrets = locked
    answer = api.post("/anomalies/1/acknowledge", headers=bearer(secrets["operator"]))
    assert done(answer)["acknowledged_by"] == "the operator"


def test_scheme_names_have_no_case(locked: Any) -> None:
    api, secrets = locked
    done(api.get("/locations", headers={"Authorization": f"bearer {secrets['operator']}"}))


def test_without_keys_loopback_is_open(tmp_path: Path) -> None:
    with open_house(tmp_path) as api:
        api.location(name="door")
        assert done(api.get("/keys"))["items"] == []
        problem(api.get("/locations", headers=bearer("tm_wrong")), 401)


def test_beyond_loopback_the_last_key_leaves_a_closed_door(tmp_path: Path) -> None:
    """Revoking the last key must not open a server that listens to others."""
    with open_house(tmp_path, host="0.0.0.0") as api:
        problem(api.get("/locations"), 401)
    with open_house(tmp_path, host="0.0.0.0", open=True) as api:
        made = done(api.post("/keys", {"name": "a", "role": "admin"}), 201)
        problem(api.get("/locations"), 401)
        assert api.request("DELETE", f"/keys/{made['id']}", headers=bearer(made["key"])).status_code == 204
        done(api.get("/locations"))


@pytest.mark.parametrize(
    ("form", "field"),
    [
        ({"name": "a", "role": "king"}, "role"),
        ({"name": "a"}, "role"),
        ({"role": "robot"}, "name"),
        ({"name": "", "role": "robot"}, "name"),
        ({"name": "x" * 129, "role": "robot"}, "name"),
        ({"name": "a\0b", "role": "robot"}, "name"),
        ({"name": 3, "role": "robot"}, "name"),
        ({"name": "a", "role": "robot", "key": "tm_mine"}, "key"),
        ({"name": "a", "role": "robot", "locations": []}, "locations"),
        ({"name": "a", "role": "robot", "locations": ["*"]}, "locations[0]"),
        ({"name": "a", "role": "robot", "locations": ["a", "b*c"]}, "locations[1]"),
        ({"name": "a", "role": "robot", "locations": ["a"] * 101}, "locations"),
        ({"name": "a", "role": "robot", "expires_at": NOW - 1}, "expires_at"),
        ({"name": "a", "role": "robot", "expires_at": "tomorrow"}, "expires_at"),
    ],
)
def test_wrong_forms(api: Api, form: Any, field: str) -> None:
    found = problem(api.post("/keys", form), 422)
    assert [each["field"] for each in found["errors"]] == [field]
    assert done(api.get("/keys"))["items"] == []

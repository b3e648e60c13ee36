"""Too many requests, too many wrong keys, and pages of other sites: refused in words, and nothing is done."""

from functools import partial
from pathlib import Path
from typing import Any

import pytest

from tests.api.house import NOW, Api, done, open_house, problem

SEEN = {"time": [NOW], "state": [1]}
open_slow = partial(open_house, requests_per_s=0.001, requests_burst=5)


def bearer(secret: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {secret}"}


def make_key(api: Api, name: str, role: str = "admin", **how: Any) -> str:
    return str(done(api.post("/keys", {"name": name, "role": role}, **how), 201)["key"])


def test_each_key_has_its_own_rate(tmp_path: Path) -> None:
    with open_slow(tmp_path) as api:
        door = api.location()
        first = make_key(api, "first")
        second = make_key(api, "second", headers=bearer(first))
        for _ in range(4):
            done(api.post(f"/locations/{door}/observations", SEEN, headers=bearer(first)), 201)
        for path in (f"/locations/{door}/observations", "/locations"):
            answer = api.post(path, SEEN, headers=bearer(first))
            assert "nothing was stored" in problem(answer, 429, "rate-limit")["detail"]
            assert 0 < int(answer.headers["retry-after"]) <= 1000
        assert done(api.get(f"/locations/{door}", headers=bearer(second)))["observations"] == 4
        metrics = api.http.request("GET", "/metrics", headers=bearer(second)).text
        assert 'tidemap_refused_total{problem="rate-limit"} 2.0' in metrics


def test_a_form_is_counted_once(tmp_path: Path) -> None:
    with open_slow(tmp_path) as api:
        key = make_key(api, "first")
        for number in range(5):
            form = {"name": f"location-{number}", "interval_s": 60}
            done(api.post("/locations", form, headers=bearer(key)), 201)
        problem(api.get("/locations", headers=bearer(key)), 429, "rate-limit")


def test_a_machine_of_its_own_is_not_limited(tmp_path: Path) -> None:
    with open_slow(tmp_path) as api:
        for _ in range(20):
            done(api.get("/locations"))


def test_an_open_server_limits_addresses(tmp_path: Path) -> None:
    with open_slow(tmp_path, host="0.0.0.0", open=True) as api:
        for _ in range(5):
            done(api.get("/locations"))
        problem(api.get("/locations"), 429, "rate-limit")


def test_wrong_keys_are_counted_by_address(tmp_path: Path) -> None:
    with open_house(tmp_path, wrong_keys_per_minute=3) as api:
        key = make_key(api, "first")
        unused = make_key(api, "second", headers=bearer(key))
        revoked = done(api.post("/keys", {"name": "third", "role": "admin"}, headers=bearer(key)), 201)
        done(api.get("/locations", headers=bearer(revoked["key"])))
        assert api.request("DELETE", f"/keys/{revoked['id']}", headers=bearer(key)).status_code == 204
        wrong = [bearer("tm_wrong"), {"Cookie": "tidemap_session=1.9999999999.abc"}, bearer("tm_other")]
        for headers in wrong:
            done(api.get("/locations", headers=bearer(key)))
            problem(api.get("/locations"), 401)
            problem(api.get("/locations", headers=headers), 401)
        for headers in (*wrong, bearer(unused)):
            answer = api.get("/locations", headers=headers)
            problem(answer, 429, "rate-limit")
            assert 0 < int(answer.headers["retry-after"]) <= 20
        problem(api.get("/locations"), 401)
        problem(api.get("/locations", headers=bearer(revoked["key"])), 401)
        done(api.get("/locations", headers=bearer(key)))


def test_the_sign_in_page_counts_wrong_keys_too(tmp_path: Path) -> None:
    with open_house(tmp_path, wrong_keys_per_minute=3) as api:
        key = make_key(api, "first")

        def sign_in(secret: str) -> int:
            return api.http.request("POST", "/login", data={"key": secret}).status_code

        assert [sign_in("tm_wrong") for _ in range(4)] == [401, 401, 401, 429]
        assert sign_in(key) == 429


OTHER = {"Origin": "http://evil.example"}
ODD_ORIGINS = ["http://evil.example", "null", "http://localhost:1", "http://[", "http://localhost.evil.example"]
WRITES = [
    ("POST", "/locations", {"name": "new", "interval_s": 60}),
    ("PATCH", "/locations/door", {"confidence": 0.8}),
    ("POST", "/locations/door/observations", SEEN),
    ("POST", "/locations/door/update", None),
    ("POST", "/anomalies/1/acknowledge", None),
    ("DELETE", "/jobs/1", None),
    ("POST", "/keys", {"name": "a", "role": "admin"}),
    ("DELETE", "/locations/door", None),
]


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """An open server on loopback with a door."""
    with open_house(tmp_path_factory.mktemp("home")) as api:
        api.location(name="door")
        yield api


@pytest.mark.parametrize(("method", "path", "form"), WRITES)
@pytest.mark.parametrize("origin", ODD_ORIGINS)
def test_a_page_of_another_site_changes_nothing(home: Api, method: str, path: str, form: Any, origin: str) -> None:
    body = {} if form is None else {"json": form}
    problem(home.request(method, path, headers={"Origin": origin}, **body), 403, "other-site")
    assert home.everything()["/jobs"]["items"] == []
    assert [location["name"] for location in home.everything()["/locations"]["items"]] == ["door"]
    assert home.facts("door")["observations"] == 0


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8000", "0.0.0.0:8000", "[::2]:80", "[", ""])
def test_a_name_that_was_turned_to_this_machine_leads_nowhere(home: Api, host: str) -> None:
    """DNS rebinding: for the browser the page and the server are one site then."""
    headers = {"Host": host, "Origin": f"http://{host}"}
    for method, path, form in [("GET", "/locations", None), ("GET", "/locations/door/state", None), *WRITES]:
        body = {} if form is None else {"json": form}
        problem(home.request(method, path, headers=headers, **body), 403, "other-site")
    assert home.http.request("GET", "/", headers=headers).status_code == 403
    assert home.http.request("GET", "/metrics", headers=headers).status_code == 403


@pytest.mark.parametrize("host", ["localhost", "localhost:8000", "127.0.0.1:8000", "[::1]:8000", "127.0.0.2"])
def test_our_own_pages_may(home: Api, host: str) -> None:
    headers = {"Host": host, "Origin": f"http://{host}"}
    done(home.get("/locations", headers=headers))
    done(home.post("/locations/door/observations", SEEN, headers=headers), 201)


def test_a_browser_that_is_signed_in_acts_from_our_own_pages_only(tmp_path: Path) -> None:
    with open_house(tmp_path, host="0.0.0.0", open=True) as api:
        door = api.location()
        key = make_key(api, "first")
        sign_in = {"data": {"key": key}}
        assert api.http.request("POST", "/login", **sign_in, headers=OTHER).status_code == 403
        cookie = api.http.request("POST", "/login", **sign_in).headers["set-cookie"].partition(";")[0]
        site = {"Cookie": cookie, "Host": "maps.example"}
        path = f"/locations/{door}/update"
        problem(api.post(path, headers={**site, **OTHER}), 403, "other-site")
        done(api.post(path, headers={**site, "Origin": "https://maps.example"}), 202)
        done(api.get("/jobs", headers={**site, **OTHER}))
        done(api.post(path, headers={**site, **OTHER, **bearer(key)}), 202)

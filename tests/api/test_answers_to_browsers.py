"""What browsers of other sites may read, and answers that are compressed on their way."""

import gzip
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import zstandard

from tests.api.house import BASE, Api, fortnight, open_house

DASHBOARD = "https://dashboard.example"
UNPACK: dict[str | None, Callable[[bytes], bytes]] = {
    "gzip": gzip.decompress,
    "zstd": lambda packed: zstandard.ZstdDecompressor().decompressobj().decompress(packed),
    None: bytes,
}


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Api]:
    with open_house(tmp_path_factory.mktemp("shared"), cors_origins=(DASHBOARD,)) as api:
        name = api.location(name="door", estimator="fft", order=3)
        api.observe(name, *fortnight())
        api.update(name)
        yield api


def test_no_other_site_may_read_by_default(tmp_path: Path) -> None:
    with open_house(tmp_path) as api:
        answer = api.get("/locations", headers={"Origin": DASHBOARD})
        assert not [name for name in answer.headers if name.startswith("access-control-")]


def test_the_sites_of_the_settings_may_read_with_a_key_and_no_cookie(house: Api) -> None:
    asked = {"Origin": DASHBOARD, "Access-Control-Request-Method": "GET"}
    allowed = house.request(
        "OPTIONS", "/locations", headers={**asked, "Access-Control-Request-Headers": "authorization"}
    )
    assert allowed.status_code == 200
    assert allowed.headers["access-control-allow-origin"] == DASHBOARD
    answer = house.get("/locations", headers={"Origin": DASHBOARD})
    assert answer.headers["access-control-allow-origin"] == DASHBOARD
    assert "access-control-allow-credentials" not in answer.headers
    assert "ETag" in answer.headers["access-control-expose-headers"]
    other = house.get("/locations", headers={"Origin": "https://evil.example"})
    assert "access-control-allow-origin" not in other.headers


@pytest.mark.parametrize(
    ("accepts", "encoding"),
    [
        ("gzip", "gzip"),
        ("zstd", "zstd"),
        ("gzip, zstd", "zstd"),
        ("zstd;q=0, gzip;q=0.1", "gzip"),
        ("br", None),
        ("", None),
    ],
)
def test_answers_are_compressed_as_they_are_accepted(house: Api, accepts: str, encoding: str | None) -> None:
    path = f"{BASE}/openapi.json"
    plain = house.http.request("GET", path, headers={"Accept-Encoding": "identity"})
    answer = house.http.raw("GET", path, headers={"Accept-Encoding": accepts})
    assert answer.headers.get("content-encoding") == encoding
    assert "accept-encoding" in answer.headers["vary"].lower()
    assert UNPACK[encoding](answer.content) == plain.content
    assert (len(answer.content) < len(plain.content) / 3) == (encoding is not None)


def test_a_compressed_answer_is_known_again(house: Api) -> None:
    path = f"{BASE}/locations/door/anomalies"
    first = house.http.request("GET", path, headers={"Accept-Encoding": "gzip"})
    again = house.http.request("GET", path, headers={"Accept-Encoding": "gzip", "If-None-Match": first.headers["etag"]})
    assert again.status_code == 304


@pytest.mark.parametrize(
    ("path", "accept"),
    [("/locations/door/state", "application/x-npy"), ("/locations/door", "application/json")],
    ids=["numbers", "short"],
)
def test_what_is_not_worth_it_stays_as_it_is(house: Api, path: str, accept: str) -> None:
    answer = house.get(path, headers={"Accept": accept, "Accept-Encoding": "gzip"})
    assert "content-encoding" not in answer.headers

"""Addresses and keys that cannot be one, proxies, and what an unreachable server is called."""

import pytest

from tests.unit.client.test_retry import QUICK
from tidemap import AsyncClient, Client
from tidemap.client import UnreachableError

PROXIES = ("HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY", "NO_PROXY")
both = pytest.mark.parametrize("form", [Client, AsyncClient])


@pytest.fixture(autouse=True)
def _no_proxy(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in PROXIES:
        monkeypatch.delenv(name, raising=False)
        monkeypatch.delenv(name.lower(), raising=False)


@both
@pytest.mark.parametrize("key", ["", "tm_secret\n", "tm_secretü", "tm_ secret", "\ttm_secret"])
def test_a_key_that_cannot_be_one_is_refused_at_once_and_not_repeated(form: type[Client], key: str) -> None:
    with pytest.raises(ValueError, match="the key") as caught:
        form("http://127.0.0.1:1", key=key)
    assert "secret" not in str(caught.value)


@both
@pytest.mark.parametrize(
    "url", ["", "127.0.0.1:8000", "robot.example", "ftp://robot.example", "http://", "http://a:b:c", "http://a/?b=c"]
)
def test_an_address_that_cannot_be_one_is_refused_at_once(form: type[Client], url: str) -> None:
    with pytest.raises(ValueError, match="no address of a server"):
        form(url)


@both
@pytest.mark.parametrize(("name", "value"), [("ALL_PROXY", "socks5://127.0.0.1:1"), ("NO_PROXY", "[::1]")])
def test_proxies_that_cannot_be_used_are_said_at_once(
    form: type[Client], name: str, value: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(name, value)
    with pytest.raises(ValueError, match="HTTP_PROXY, HTTPS_PROXY, ALL_PROXY and NO_PROXY"):
        form("http://127.0.0.1:1")


@pytest.mark.parametrize("url", ["http://127.0.0.1:1", "http://[::1]:1"])
def test_unreachable_names_host_and_port(url: str) -> None:
    with Client(url, retry=QUICK) as client, pytest.raises(UnreachableError) as caught:
        client.location("door").get()
    assert url.removeprefix("http://") in str(caught.value)
    assert "/locations/door" in str(caught.value)


def test_unreachable_names_the_proxy_without_its_password(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HTTP_PROXY", "http://me:hidden@127.0.0.1:9")
    with Client("http://robot.example", retry=QUICK) as client, pytest.raises(UnreachableError) as caught:
        client.location("door").get()
    assert "robot.example:80 through the proxy http://127.0.0.1:9" in str(caught.value)
    assert "hidden" not in str(caught.value)

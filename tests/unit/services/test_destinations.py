"""Where webhooks may go: the address that was checked is the one that is connected to."""

import asyncio
import socket
from ipaddress import ip_address
from typing import Any

import pytest

from tidemap.errors import DestinationError
from tidemap.services.destinations import Destination, is_public, resolve

URL = "https://alarms.example.org/tidemap?a=b"


def resolved(monkeypatch: pytest.MonkeyPatch, *addresses: str, url: str = URL, private: bool = False) -> Destination:
    """Where the URL leads while its name stands for these addresses; they are asked for once."""

    async def run() -> Destination:
        loop, asked = asyncio.get_running_loop(), []

        async def getaddrinfo(host: str, port: int, **_: Any) -> list[Any]:
            asked.append(host)
            return [(socket.AF_INET, socket.SOCK_STREAM, 6, "", (each, port)) for each in addresses]

        monkeypatch.setattr(loop, "getaddrinfo", getaddrinfo, raising=False)
        found = await resolve(url, private)
        assert len(asked) == 1
        return found

    return asyncio.run(run())


def test_the_address_is_taken_and_the_name_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    found = resolved(monkeypatch, "93.184.216.34")
    assert str(found.url) == "https://93.184.216.34/tidemap?a=b"
    assert (found.host, found.header) == ("alarms.example.org", "alarms.example.org")
    found = resolved(monkeypatch, "2606:2800:220:1::1", url="https://alarms.example.org:8443/")
    assert str(found.url) == "https://[2606:2800:220:1::1]:8443/"
    assert found.header == "alarms.example.org:8443"


@pytest.mark.parametrize(
    "addresses",
    [("127.0.0.1",), ("10.0.0.1", "192.168.0.1"), ("::1",), ("fe80::1%eth0",), ("fd00::1",), ("0.0.0.0",), ()],
)
def test_a_name_of_private_addresses_leads_nowhere(monkeypatch: pytest.MonkeyPatch, addresses: tuple[str, ...]) -> None:
    with pytest.raises(DestinationError, match="private networks"):
        resolved(monkeypatch, *addresses)


def test_of_several_addresses_a_public_one_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    assert resolved(monkeypatch, "127.0.0.1", "93.184.216.34").url.host == "93.184.216.34"
    assert resolved(monkeypatch, "127.0.0.1", "93.184.216.34", private=True).url.host == "127.0.0.1"


def test_a_url_that_is_not_allowed_any_more_leads_nowhere(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(DestinationError, match="https"):
        resolved(monkeypatch, "93.184.216.34", url="http://alarms.example.org")


@pytest.mark.parametrize(
    ("address", "public"),
    [
        ("93.184.216.34", True),
        ("2606:2800:220:1::1", True),
        ("172.16.0.1", False),
        ("100.64.0.1", False),
        ("224.0.0.1", False),
        ("255.255.255.255", False),
        ("::", False),
        ("ff02::1", False),
        ("::ffff:10.0.0.1", False),
        ("::ffff:93.184.216.34", False),
        ("::ffff:0:127.0.0.1", False),
        ("::7f00:1", False),
        ("2002:0a00:0001::", False),
        ("2002:5db8:d822::", False),
        ("2001:0:5db8:d822::a247:27dd", False),
        ("2001:db8::1", False),
        ("64:ff9b:1::a00:1", False),
        ("64:ff9b:1::5db8:d822", False),
        ("fec0::1", False),
        ("5f00::1", False),
        ("100:0:0:1::1", False),
        ("2a00:1450:4001:80b::200e", True),
        ("64:ff9b::7f00:1", False),
        ("64:ff9b::5db8:d822", True),
    ],
)
def test_public_addresses(address: str, public: bool) -> None:
    assert is_public(ip_address(address)) is public

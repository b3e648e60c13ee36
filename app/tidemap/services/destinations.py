"""Where webhooks may go: not to addresses of the server's own networks, whatever a name is said to stand for."""

import asyncio
import socket
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv6Address, IPv6Network, ip_address

import httpx

from tidemap.errors import DestinationError, InvalidInputError

PORTS = frozenset({None, *range(1, 65536)})
NAT64 = IPv6Network("64:ff9b::/96")
UNICAST = IPv6Network("2000::/3")
"""All of IPv6 that is given out for the public internet (RFC 4291)."""


@dataclass(frozen=True, slots=True)
class Destination:
    """A checked address behind a URL, so that it is not looked up again: `host` is what the URL calls it."""

    url: httpx.URL
    host: str
    header: str


def check_destination(url: str, private: bool) -> None:
    """Raises InvalidInputError for a URL that nothing can be sent to; `private` networks may be allowed."""
    problem = _problem(url, private)
    if problem is not None:
        raise InvalidInputError.at("url", problem)


def _problem(url: str, private: bool) -> str | None:
    try:
        parts = httpx.URL(url)
        port = parts.port
    except (httpx.InvalidURL, ValueError) as error:
        return f"this is no URL ({error})"
    if parts.scheme not in ("https", "http") or not parts.host:
        return "give an address such as https://alarms.example.org/tidemap"
    if parts.userinfo or parts.fragment or port not in PORTS:
        return "leave out user, password and fragment; ports are 1 to 65535"
    if private:
        return None
    if parts.scheme != "https":
        return "give https://, or set TIDEMAP_WEBHOOKS_PRIVATE to send within networks of your own"
    literal = _literal(parts.host)
    if literal is not None and not is_public(literal):
        return "this is an address of a private network; set TIDEMAP_WEBHOOKS_PRIVATE to allow these"
    return None


async def resolve(url: str, private: bool) -> Destination:
    """The first address behind a URL that may be sent to. Raises DestinationError, which says what is wrong."""
    if (problem := _problem(url, private)) is not None:
        raise DestinationError(problem)
    parts = httpx.URL(url)
    port = parts.port or (443 if parts.scheme == "https" else 80)
    try:
        found = await asyncio.get_running_loop().getaddrinfo(parts.host, port, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as error:
        raise DestinationError(f"{parts.host} is not found: {error}") from None
    for *_, address in found:
        literal = _literal(str(address[0]))
        if literal is not None and (private or is_public(literal)):
            return Destination(parts.copy_with(host=str(literal)), parts.host, parts.netloc.decode("ascii"))
    raise DestinationError(
        f"{parts.host} stands for addresses of private networks; TIDEMAP_WEBHOOKS_PRIVATE allows them"
    )


def is_public(address: IPv4Address | IPv6Address) -> bool:
    """Whether an address is of the public internet. One of NAT64 is as public as the IPv4 address in it; other kinds
    that hold one (mapped, 6to4, Teredo) are refused, for their way on is not known.

    >>> addresses = ("93.184.216.34", "10.1.2.3", "127.0.0.1", "169.254.169.254", "::ffff:127.0.0.1", "64:ff9b::a00:1")
    >>> [is_public(ip_address(each)) for each in addresses]
    [True, False, False, False, False, False]
    """
    if isinstance(address, IPv6Address):
        if address in NAT64:
            return is_public(IPv4Address(int(address) & 0xFFFFFFFF))
        if address not in UNICAST or address.sixtofour or address.teredo:
            return False
    return address.is_global and not address.is_multicast


def _literal(host: str) -> IPv4Address | IPv6Address | None:
    try:
        return ip_address(host.partition("%")[0])
    except ValueError:
        return None

"""Origins: requests that a page of another site makes in some browser are refused."""

from urllib.parse import urlsplit

from starlette.requests import HTTPConnection

from tidemap.api.state import state_of
from tidemap.errors import OtherSiteError
from tidemap.settings import is_loopback

READING = frozenset({"GET", "HEAD", "OPTIONS"})


def refuse_other_sites(connection: HTTPConnection) -> None:
    """Refuse what a page of another site does in some browser: its user did not ask for it. Raises OtherSiteError.

    A browser names the site of the page with every request that may change something, and with every socket.
    """
    origin = connection.headers.get("origin")
    if origin is None or connection.scope.get("method") in READING:
        return
    if _part(origin, "netloc") != connection.headers.get("host"):
        host = connection.headers.get("host")
        raise OtherSiteError(
            f"A page at {origin} may do nothing at {host}. Programs send a key, and no Origin. If both are the same "
            "site, the proxy between has to pass the Host header on."
        )


def refuse_strangers(connection: HTTPConnection) -> None:
    """Refuse what pages of other sites do on an open server. Raises OtherSiteError."""
    _refuse_other_hosts(connection)
    refuse_other_sites(connection)


def _refuse_other_hosts(connection: HTTPConnection) -> None:
    """Where only this machine reaches an open server, a page of another site may have its name lead here instead.

    Raises OtherSiteError.
    """
    settings, host = state_of(connection).ctx.settings, connection.headers.get("host")
    if settings.open or not is_loopback(settings.host) or host is None or is_loopback(_part(f"//{host}", "hostname")):
        return
    raise OtherSiteError(
        f"While no key exists this server answers to localhost and 127.0.0.1 only, and it was asked as {host!r}. "
        "Use one of these names, or make a key with 'tidemap keys create'."
    )


def _part(url: str, name: str) -> str:
    """A part of a URL; empty where there is none."""
    try:
        return getattr(urlsplit(url), name) or ""
    except ValueError:
        return ""

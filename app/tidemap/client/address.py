"""The server's address, and the proxy that the environment puts before it."""

from urllib.request import getproxies, proxy_bypass

import httpx

from tidemap.client.errors import UnreachableError

SECURE = {"http": False, "https": True, "ws": False, "wss": True}


def check_url(url: str) -> None:
    """Raises ValueError for what is no address of a server."""
    try:
        parts = httpx.URL(url)
    except httpx.InvalidURL as error:
        raise ValueError(
            f"{url!r} is no address of a server ({error}); give one such as http://127.0.0.1:8000"
        ) from None
    if parts.scheme not in ("http", "https") or not parts.host or parts.query or parts.fragment:
        raise ValueError(f"{url!r} is no address of a server; give one such as http://127.0.0.1:8000, with its http://")


def unreachable(path: str, error: httpx.RequestError) -> UnreachableError:
    """The error of a request below `path` that nobody answered, with the address that it went to."""
    try:
        where = f"{address(str(error.request.url))}, {path}"
    except RuntimeError:
        # httpx gave the error no request.
        where = path
    return UnreachableError(where, error)


def address(url: str) -> str:
    """Host and port of a URL, and the proxy that requests to it go through, if there is one.

    >>> address("http://127.0.0.1/api/v1")
    '127.0.0.1:80'
    """
    parts = httpx.URL(url)
    host = f"[{parts.host}]" if ":" in parts.host else parts.host
    proxy = _proxy(parts)
    return f"{host}:{parts.port or (443 if SECURE[parts.scheme] else 80)}" + (
        f" through the proxy {proxy}" if proxy else ""
    )


def _proxy(url: httpx.URL) -> str | None:
    """The environment's proxy for a URL, without the password that it may hold."""
    proxies = getproxies()
    proxy = proxies.get("https" if SECURE[url.scheme] else "http", proxies.get("all"))
    if not proxy or proxy_bypass(url.host):
        return None
    parts = httpx.URL(proxy if "://" in proxy else f"http://{proxy}")
    return str(parts.copy_with(username=None, password=None))

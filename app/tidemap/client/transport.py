"""Which server, and what both clients tell it about themselves."""

import re
from typing import Any, TypeVar

import httpx
from typing_extensions import TypedDict

from tidemap.client.address import check_url
from tidemap.client.retry import RetryPolicy
from tidemap.version import __version__

Http = TypeVar("Http", httpx.Client, httpx.AsyncClient)


class RequestOptions(TypedDict, total=False):
    """Options that both clients have, whether there is an outbox or not."""

    timeout_s: float
    retry: RetryPolicy | None
    outbox_bytes: int


class Server:
    """A server: `base` is the URL of its API, `headers` go with every request.

    Raises ValueError for an address or a key that cannot be one, without repeating the key.

    >>> Server("http://127.0.0.1:8000/", None).base
    'http://127.0.0.1:8000/api/v1'
    """

    def __init__(self, url: str, key: str | None) -> None:
        check_url(url)
        self.base = url.rstrip("/") + "/api/v1"
        self.headers = {"User-Agent": f"tidemap-client/{__version__}"}
        if key is not None:
            _check_key(key)
            self.headers["Authorization"] = f"Bearer {key}"

    def open(self, form: type[Http], timeout: Any) -> Http:
        """A pool of connections to the server. Raises ValueError where the environment's proxies cannot be used."""
        try:
            return form(base_url=self.base, headers=self.headers, timeout=timeout)
        except (ImportError, ValueError, httpx.InvalidURL) as error:
            raise ValueError(
                f"the environment names a proxy that cannot be used ({error}); "
                "correct HTTP_PROXY, HTTPS_PROXY, ALL_PROXY and NO_PROXY, or unset them"
            ) from error


def _check_key(key: str) -> None:
    if not re.fullmatch(r"[!-~]+", key):
        raise ValueError(
            "the key is empty, or holds a space, a line's end or a letter that no key has; "
            "give it as 'tidemap keys create' printed it, or None for a server without keys"
        )

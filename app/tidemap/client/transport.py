"""Which server, and what both clients tell it about themselves."""

from tidemap import __version__


class Server:
    """A server: `base` is the URL of its API, `headers` go with every request.

    >>> Server("http://127.0.0.1:8000/", None).base
    'http://127.0.0.1:8000/api/v1'
    """

    def __init__(self, url: str, key: str | None) -> None:
        self.base = url.rstrip("/") + "/api/v1"
        self.headers = {"User-Agent": f"tidemap-client/{__version__}"}
        if key is not None:
            self.headers["Authorization"] = f"Bearer {key}"

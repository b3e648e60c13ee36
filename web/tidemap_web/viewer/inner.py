"""Viser on a loopback port that only this process may use: every connection shows a secret."""

import hmac
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http import HTTPStatus
from types import SimpleNamespace
from typing import Any
from urllib.parse import parse_qs, urlsplit

import viser
from viser.infra import _infra
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

SHOWN_IN = "Tidemap-Viewer"
"""The header that shows the secret."""
Knows = Callable[[str], bool]


class InnerViser(viser.ViserServer):
    """Viser without its tunnel to a public server, and closed to everybody who has not got `secret`.

    A request also names the token of an open tab, and comes from no page: browsers send an Origin, our proxy none.
    """

    def __init__(self, knows: Knows) -> None:
        self.secret = secrets.token_urlsafe(32)
        with _asking(lambda request: _allowed(request, self.secret, knows)):
            super().__init__(host="127.0.0.1", port=0, verbose=False)

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Share nothing."""
        return None


def token_of(request: Request) -> str:
    """The token of a tab in the address that was connected to."""
    return parse_qs(urlsplit(request.path).query).get("token", [""])[0]


def _allowed(request: Request, secret: str, knows: Knows) -> bool:
    shown = request.headers.get(SHOWN_IN, "")
    right = hmac.compare_digest(shown.encode(), secret.encode())
    return right and "Origin" not in request.headers and knows(token_of(request))


@contextmanager
def _asking(allowed: Callable[[Request], bool]) -> Iterator[None]:
    """Meanwhile viser's servers ask `allowed` before they answer anything: viser has no place to say so.

    It looks up `websockets.asyncio.server.serve` when it starts; this is done for the exact version that is pinned.
    """
    names = vars(_infra)
    websockets = names["websockets"]
    serve = websockets.asyncio.server.serve

    def guarded(*arguments: Any, process_request: Any, **how: Any) -> Any:
        def process(connection: ServerConnection, request: Request) -> Response | None:
            if not allowed(request):
                return connection.respond(HTTPStatus.FORBIDDEN, "Not from here.\n")
            answer: Response | None = process_request(connection, request)
            return answer

        return serve(*arguments, process_request=process, **how)

    server = SimpleNamespace(**{**vars(websockets.asyncio.server), "serve": guarded})
    names["websockets"] = SimpleNamespace(**{**vars(websockets), "asyncio": SimpleNamespace(server=server)})
    try:
        yield
    finally:
        names["websockets"] = websockets

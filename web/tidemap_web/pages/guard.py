"""Who may see the pages: anybody on a server without keys, else people who signed in with an operator's key."""

import re
from typing import Any
from urllib.parse import quote, urlsplit

from fastapi import Request, Response
from fastapi.responses import RedirectResponse
from starlette.requests import HTTPConnection

from tidemap.api.auth import COOKIE, authenticate, counting_wrong_keys
from tidemap.api.errors import domain_response
from tidemap.api.origins import refuse_other_sites
from tidemap.api.scopes import check_name
from tidemap.errors import DomainError, ForbiddenError, UnauthorizedError
from tidemap.scope import Scope
from tidemap.services.context import Context
from tidemap.services.keys import OPEN, SESSION_S, Principal, allows, by_secret, end_session, start_session

_PAGE = re.compile(
    r"/(\?[^\\#]*)?|/anomalies(\?[^\\#]*)?|/new|/locations/[^/\\?#]+(/report)?(\?[^\\#]*)?|/view/?(\?[^\\#]*)?|/api/docs"
)
NO_STORE = {"Cache-Control": "no-store"}


def principal(connection: HTTPConnection) -> Principal:
    """Who asks, if they may look. Raises UnauthorizedError, ForbiddenError, OtherSiteError, RateLimitError."""
    found = authenticate(connection)
    if not allows(found.role, "operator"):
        raise ForbiddenError("A robot's key is for posting; the pages need an operator's key.")
    return found


def scope_of(connection: HTTPConnection) -> Scope:
    """Which locations who asks may see. Raises as `principal`."""
    return principal(connection).scope


def check_location(connection: HTTPConnection, name: str) -> None:
    """Raises OutOfScopeError for a location that who asks may not see, and as `principal`."""
    check_name(principal(connection), name)


def signed_in(request: Request) -> Principal | None:
    """Who is named at the top of a page; nobody on an open server."""
    try:
        found = principal(request)
    except DomainError:
        return None
    return None if found == OPEN else found


def header(ctx: Context, request: Request) -> dict[str, Any]:
    """What the header of every page shows."""
    return {"signed_in": signed_in(request), "has_viewer": ctx.settings.viewer, "now": ctx.clock()}


def refuse(request: Request) -> Response | None:
    """401 or 403 for a visitor who may not look, None for one who may."""
    try:
        principal(request)
    except UnauthorizedError as error:
        return Response(str(error), 401, {"WWW-Authenticate": "Bearer", **NO_STORE}, "text/plain")
    except ForbiddenError as error:
        return Response(str(error), 403, NO_STORE, "text/plain")
    return None


def redirect(request: Request) -> Response | None:
    """Send a visitor who may not look to the sign-in page; None for one who may."""
    if refuse(request) is None:
        return None
    if "hx-request" in request.headers:
        shown = urlsplit(request.headers.get("hx-current-url", "/"))
        return Response(status_code=401, headers={"HX-Redirect": _login(shown.path or "/"), **NO_STORE})
    query = f"?{request.url.query}" if request.url.query else ""
    return RedirectResponse(_login(request.url.path + query), 303, NO_STORE)


def refuse_socket(socket: HTTPConnection) -> Response | None:
    """What to answer to a WebSocket that may not open: 401, 403 or 429; None for one that may.

    Its sender has to be allowed to look, and to come from our own pages if it is a browser.
    """
    try:
        refuse_other_sites(socket)
        principal(socket)
    except DomainError as error:
        return domain_response(socket.url.path, error)
    return None


def sign_in(ctx: Context, request: Request, secret: str, then: str) -> Response:
    """Remember a browser by its key for as long as a session lasts.

    Raises UnauthorizedError, ForbiddenError, OtherSiteError, RateLimitError.
    """
    refuse_other_sites(request)
    with counting_wrong_keys(request, secret):
        found = by_secret(ctx, secret)
    if not allows(found.role, "operator"):
        raise ForbiddenError("This is a robot's key, which is for posting. Sign in with an operator's key.")
    answer = RedirectResponse(then, 303, NO_STORE)
    answer.set_cookie(
        COOKIE,
        start_session(ctx, secret),
        max_age=int(SESSION_S),
        httponly=True,
        samesite="strict",
        secure=request.url.scheme == "https",
    )
    return answer


def sign_out(ctx: Context, request: Request) -> Response:
    """End a browser's session. Raises OtherSiteError."""
    refuse_other_sites(request)
    if token := request.cookies.get(COOKIE):
        end_session(ctx, token)
    answer = RedirectResponse("/login", 303, NO_STORE)
    answer.delete_cookie(COOKIE, httponly=True, samesite="strict")
    return answer


def local(address: str) -> str:
    """The address of one of our pages, or the first page: nobody is sent elsewhere.

    >>> local("/locations/lab?cell=3"), local("//evil.example"), local("/\\\\evil"), local("/view/scene/?websocket=x")
    ('/locations/lab?cell=3', '/', '/', '/')
    """
    return address if _PAGE.fullmatch(address) and address.isprintable() else "/"


def _login(address: str) -> str:
    return f"/login?next={quote(address, safe='')}"

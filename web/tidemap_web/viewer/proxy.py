"""The viewer on our own port: its page, viser's client in a frame, and the sockets of both."""

import re
import secrets
from urllib.parse import quote

from fastapi import APIRouter, Request, Response, WebSocket
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import RedirectResponse

from tidemap.errors import DomainError, LocationNotFoundError
from tidemap.services.context import Context
from tidemap.services.locations import find_location
from tidemap_web.pages import guard
from tidemap_web.pages.problems import problem_page
from tidemap_web.pages.templates import page
from tidemap_web.viewer import colors
from tidemap_web.viewer.client import client_page, scene_address
from tidemap_web.viewer.messages import PageMessage
from tidemap_web.viewer.server import ViewerServer
from tidemap_web.viewer.sockets import converse, pipe

_TOKEN = re.compile(r"[A-Za-z0-9_-]{16,64}")


def router(ctx: Context, viewer: ViewerServer) -> APIRouter:
    """Everything under /view."""
    routes = APIRouter(prefix="/view", include_in_schema=False)

    @routes.get("", response_model=None)
    @routes.get("/", response_model=None)
    def view(request: Request) -> Response:
        """The viewer's page; see core/address.js for what its query chooses."""
        try:
            if redirected := guard.redirect(request):
                return redirected
            if elsewhere := _page_of_state(ctx, request.query_params.get("location", "")):
                return elsewhere
        except DomainError as error:
            return problem_page(request, error)
        facts = {
            "token": secrets.token_urlsafe(18),
            "scene": scene_address(),
            "gradient": colors.gradient_css(),
            "structure": colors.structure_css(),
            "ages": colors.gradient_css(low=0.1),
            "differences": colors.differences_css(),
            "swatches": _swatches(),
            "embedded": "embed" in request.query_params,
            **guard.header(ctx, request),
        }
        return page(request, "viewer.html", facts)

    @routes.get("/scene/", response_model=None)
    def scene(request: Request) -> Response:
        """Viser's own client, which draws the scene."""
        if refused := guard.refuse(request):
            return refused
        address = scene_address(request.query_params)
        if f"{request.url.path}?{request.url.query}" != address:
            return RedirectResponse(address, 303, guard.NO_STORE)
        return _scene_page(request)

    @routes.get("/sessions", response_model=None)
    def sessions(request: Request) -> Response | list[PageMessage]:
        """What every open tab shows, of the locations that who asks may see; for tests and operators."""
        if refused := guard.refuse(request):
            return refused
        scope = guard.scope_of(request)
        return [each for each in viewer.stats() if each["location"] is None or scope.holds(each["location"])]

    @routes.websocket("/control/{token}")
    async def control(socket: WebSocket, token: str) -> None:
        """The page's requests and the session's answers."""
        if refused := await run_in_threadpool(guard.refuse_socket, socket):
            await socket.send_denial_response(refused)
            return
        if not _TOKEN.fullmatch(token):
            await socket.send_denial_response(_no_such_tab())
            return
        await socket.accept()
        await converse(socket, viewer, token, await run_in_threadpool(guard.principal, socket))

    @routes.websocket("/scene/{token}")
    async def through(socket: WebSocket, token: str) -> None:
        """Viser's socket, passed through."""
        if refused := await run_in_threadpool(guard.refuse_socket, socket):
            await socket.send_denial_response(refused)
            return
        if not viewer.knows(token):
            await socket.send_denial_response(_no_such_tab())
            return
        await pipe(socket, viewer, token)

    return routes


def _page_of_state(ctx: Context, name: str) -> Response | None:
    """A location without a grid has no scene, but a page."""
    try:
        location = find_location(ctx, name)
    except LocationNotFoundError:
        return None
    if location.grid is not None:
        return None
    return RedirectResponse(f"/locations/{quote(name, safe='')}", 303, guard.NO_STORE)


def _scene_page(request: Request) -> Response:
    """Viser's client; browsers ask each time whether theirs is the current one, so no old policy lives on."""
    client = client_page()
    headers = {
        "Content-Security-Policy": client.csp,
        "X-Content-Type-Options": "nosniff",
        "Cache-Control": "private, no-cache",
        "ETag": f'"{client.version}"',
    }
    if request.headers.get("if-none-match") == headers["ETag"]:
        return Response(status_code=304, headers=headers)
    return Response(client.body, media_type="text/html", headers={"Content-Encoding": "gzip", **headers})


def _no_such_tab() -> Response:
    return Response("No open tab has this token. Reload the viewer.", 404, guard.NO_STORE, "text/plain")


def _swatches() -> dict[str, str]:
    return {
        "occupied": colors.css(colors.OCCUPIED),
        "unexpected": colors.css(colors.UNEXPECTED),
        "missing": colors.css(colors.MISSING),
        "stale": colors.css(colors.STALE),
        "uncertain": colors.css_of_probability(0.5),
        "free": colors.css_of_probability(0.1),
        "track": colors.css(colors.TRACK),
        "unknown": colors.css(colors.UNKNOWN),
    }

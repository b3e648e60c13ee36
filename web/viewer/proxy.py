"""The viewer on our own port: its page, viser's client in a frame, and the sockets of both."""

import asyncio
import contextlib
import gzip
import re
import secrets
from collections.abc import AsyncIterator
from functools import cache
from hashlib import sha256
from pathlib import Path

import viser
from fastapi import APIRouter, Request, Response, WebSocket, WebSocketDisconnect
from fastapi.concurrency import run_in_threadpool
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, WebSocketException
from websockets.typing import Subprotocol

from app.services.context import Context
from web.pages import guard
from web.pages.templates import page
from web.viewer import colors
from web.viewer.messages import Message, parse
from web.viewer.server import ViewerServer

_TOKEN = re.compile(r"[A-Za-z0-9_-]{16,64}")
_UNKNOWN_TAB = 4404
_VISER_CSP = (
    "default-src 'none'; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:; style-src 'unsafe-inline'; "
    "img-src data: blob:; font-src data:; worker-src blob:; connect-src 'self' data: blob: ws: wss:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)


def router(ctx: Context, viewer: ViewerServer) -> APIRouter:
    """Everything under /view."""
    routes = APIRouter(prefix="/view", include_in_schema=False)

    @routes.get("", response_model=None)
    @routes.get("/", response_model=None)
    def view(request: Request) -> Response:
        """The viewer's page. `?location=` and `?time=` choose what it opens with."""
        if turned_away := guard.redirect(ctx, request):
            return turned_away
        facts = {
            "token": secrets.token_urlsafe(18),
            "scene": f"/view/scene/?v={_client_page()[1]}",
            "gradient": colors.gradient_css(),
            "swatches": _swatches(),
            "embedded": "embed" in request.query_params,
            "signed_in": guard.signed_in(ctx, request),
        }
        return page(request, "viewer.html", facts)

    @routes.get("/scene/", response_model=None)
    def scene(request: Request) -> Response:
        """Viser's own client, which draws the scene."""
        if refused := guard.refuse(ctx, request):
            return refused
        body, _ = _client_page()
        return Response(
            body,
            media_type="text/html",
            headers={
                "Content-Encoding": "gzip",
                "Content-Security-Policy": _VISER_CSP,
                "X-Content-Type-Options": "nosniff",
                "Cache-Control": "private, max-age=31536000, immutable",
            },
        )

    @routes.get("/sessions", response_model=None)
    def sessions(request: Request) -> Response | list[Message]:
        """What every open tab shows, for tests and operators."""
        return guard.refuse(ctx, request) or viewer.stats()

    @routes.websocket("/control/{token}")
    async def control(socket: WebSocket, token: str) -> None:
        """The page's wishes and the session's answers."""
        if not await run_in_threadpool(guard.allows_socket, ctx, socket) or not _TOKEN.fullmatch(token):
            await socket.close(1008)
            return
        await socket.accept()
        await _converse(socket, viewer, token)

    @routes.websocket("/scene/{token}")
    async def pipe(socket: WebSocket, token: str) -> None:
        """Viser's socket, passed through."""
        if not await run_in_threadpool(guard.allows_socket, ctx, socket) or not viewer.knows(token):
            await socket.close(_UNKNOWN_TAB)
            return
        await _pipe(socket, viewer.port, token)

    return routes


def _swatches() -> dict[str, str]:
    return {
        "occupied": colors.css(colors.OCCUPIED),
        "unexpected": colors.css(colors.UNEXPECTED),
        "missing": colors.css(colors.MISSING),
        "stale": colors.css(colors.STALE),
    }


@cache
def _client_page() -> tuple[bytes, str]:
    """Viser's page with our few lines at its head, gzipped, and its version."""
    html = (Path(viser.__file__).parent / "client" / "build" / "index.html").read_text("utf-8")
    head = (Path(__file__).parent / "scene_head.html").read_text("utf-8")
    background = colors.css(colors.BACKGROUND)
    html = html.replace("<head>", "<head>" + head.replace("BACKGROUND", background), 1)
    body = gzip.compress(html.encode("utf-8"))
    return body, f"{viser.__version__}-{sha256(body[10:]).hexdigest()[:8]}"


class Outbox:
    """Messages on their way to a page; the newest of a kind replaces one that has not left yet."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._waiting: dict[str, Message] = {}
        self._filled = asyncio.Event()

    def put(self, message: Message) -> None:
        """Leave a message; from any thread, never waits."""
        with contextlib.suppress(RuntimeError):  # the loop has closed: nobody is left to read
            self._loop.call_soon_threadsafe(self._keep, message)

    def _keep(self, message: Message) -> None:
        self._waiting.pop(message["kind"], None)
        self._waiting[message["kind"]] = message
        self._filled.set()

    async def taken(self) -> AsyncIterator[Message]:
        """Messages in the order they came, for ever."""
        while True:
            await self._filled.wait()
            self._filled.clear()
            while self._waiting:
                yield self._waiting.pop(next(iter(self._waiting)))


async def _converse(socket: WebSocket, viewer: ViewerServer, token: str) -> None:
    outbox = Outbox()
    session = viewer.open(token, outbox.put)

    async def speak() -> None:
        async for message in outbox.taken():
            await socket.send_json(message)

    async def listen() -> None:
        async for text in socket.iter_text():
            try:
                session.ask(parse(text))
            except ValueError as error:
                await socket.send_json({"kind": "refused", "detail": str(error)})

    try:
        await _first_of(speak(), listen())
    finally:
        viewer.close(session)


async def _pipe(socket: WebSocket, port: int, token: str) -> None:
    """Pass frames both ways unchanged until either end closes."""
    protocols = [Subprotocol(name) for name in socket.scope.get("subprotocols", [])]
    address = f"ws://127.0.0.1:{port}/?token={token}"
    try:
        inner = await connect(
            address, subprotocols=protocols or None, max_size=None, compression=None, ping_interval=None
        )
    except (OSError, WebSocketException):
        await socket.close(1013)
        return
    async with inner:
        await socket.accept(subprotocol=inner.subprotocol)
        await _first_of(_inward(socket, inner), _outward(socket, inner))
        with contextlib.suppress(RuntimeError, WebSocketDisconnect):
            await socket.close(1001)


async def _inward(socket: WebSocket, inner: ClientConnection) -> None:
    async for data in socket.iter_bytes():
        await inner.send(data)


async def _outward(socket: WebSocket, inner: ClientConnection) -> None:
    async for data in inner:
        if isinstance(data, bytes):
            await socket.send_bytes(data)
        else:
            await socket.send_text(data)


async def _first_of(*ways: "asyncio._CoroutineLike[None]") -> None:
    """Run until the first ends, then end the others; a closed connection is an ordinary end."""
    tasks = [asyncio.create_task(way) for way in ways]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        for outcome in await asyncio.gather(*tasks, return_exceptions=True):
            if isinstance(outcome, Exception) and not isinstance(
                outcome, ConnectionClosed | WebSocketDisconnect | RuntimeError
            ):
                raise outcome

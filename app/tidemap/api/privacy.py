"""Privacy: what may be kept of an answer on its way. Only the browser of who asked may keep one, and not a secret."""

from starlette.types import ASGIApp, Message, Receive, Scope, Send

CACHE_CONTROL = b"cache-control"
NOT_KEPT = b"private, no-store"
ASKED_ANEW = b"private, no-cache"
"""Of answers with an ETag: kept, and asked for again before they are used."""
PUBLIC = ("/static/", "/api/docs", "/healthz", "/readyz", "/api/v1/openapi.json")
"""The same for everybody."""


class Privacy:
    """ASGI middleware: every answer that may need a key says how it may be kept, unless it does already."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or scope["path"].startswith(PUBLIC):
            await self._app(scope, receive, send)
            return

        async def marked(message: Message) -> None:
            if message["type"] == "http.response.start":
                names = {name for name, _ in message["headers"]}
                if CACHE_CONTROL not in names:
                    kept = ASKED_ANEW if b"etag" in names else NOT_KEPT
                    message["headers"] = [*message["headers"], (CACHE_CONTROL, kept)]
            await send(message)

        await self._app(scope, receive, marked)

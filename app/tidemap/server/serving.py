"""Serving with uvicorn until SIGTERM or SIGINT, and the demo beside it where asked."""

import asyncio
import gc
import logging
import signal
import socket
import sys
from asyncio import Protocol
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from typing import Any, cast

import uvicorn

from tidemap.api.state import state_of_app
from tidemap.server.binding import url_of
from tidemap.server.census import Census
from tidemap.server.demo import Demo
from tidemap.server.ending import end_within
from tidemap.server.memory import periodic_trim
from tidemap.server.processes import Extension, all_in_one
from tidemap.server.protocol import BoundedHttpProtocol, BoundedWebSocketProtocol
from tidemap.server.warming import warm_up
from tidemap.services.context import Context
from tidemap.services.keys import is_open
from tidemap.settings import is_loopback
from tidemap.storage.store import shown
from tidemap.version import __version__

log = logging.getLogger(__name__)
GRACE_S = 10
MAX_MESSAGE_BYTES = 2**20
"""Largest message of a WebSocket's client; what the server sends has no such bound."""
SWITCH_S = 0.0005
"""Threads that compute give way after so long: one that reads gives way at every row, and waited 5 ms for each."""


@dataclass(frozen=True, slots=True)
class ServeOptions:
    """What runs beside the site."""

    demo: bool = False


class _Server(uvicorn.Server):
    """Says where it listens once it does."""

    def __init__(self, config: uvicorn.Config, ready: Callable[[], None], stopping: Callable[[], None]) -> None:
        super().__init__(config)
        self._ready = ready
        self._stopping = stopping

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Listen, then say so."""
        await super().startup(sockets)
        if self.started:
            await asyncio.to_thread(self._ready)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Say that work for answers is to end, then wait for it."""
        self._stopping()
        await super().shutdown(sockets)


def serve(ctx: Context, bound: socket.socket, options: ServeOptions, *extensions: Extension) -> int:
    """Serve all in one at a bound socket, with extensions such as pages, until stopped; 0 when that went well.

    Once it is to stop, the whole process ends within `max_stop_s`.
    """
    settings = ctx.settings
    sys.setswitchinterval(SWITCH_S)
    with ExitStack() as stack:
        warm_up()
        stack.enter_context(periodic_trim())
        site = stack.enter_context(all_in_one(ctx, *extensions))
        census = Census(settings.max_connections, settings.max_connections_per_address)
        config = configure(site, settings.host, settings.port, census)
        url = url_of(bound)

        log.info("Tidemap %s on %s; %s", __version__, shown(settings.url), who_enters(ctx))

        def ready() -> None:
            # As one: print writes the end of a line by itself, and others log meanwhile.
            print(f"Tidemap is ready at {url}\n", end="", flush=True)
            if options.demo:
                stack.enter_context(Demo(ctx, url))

        def stopping() -> None:
            state_of_app(site).stopping.set()
            end_within(settings.max_stop_s, ctx.store.waiting)

        server = _Server(config, ready, stopping)
        for asked in (signal.SIGTERM, signal.SIGINT):
            # uvicorn raises the signal again once it has stopped; what is left to close here comes after that.
            signal.signal(asked, lambda *_: None)
        # What has come so far stays: a collection need not look at it again.
        gc.freeze()
        server.run([bound])
        log.info("Tidemap has answered what it took, and stops")
        return 0 if server.started else 1


def who_enters(ctx: Context) -> str:
    """In words, for the log: who may do something here."""
    if not is_open(ctx):
        return "who shows a key may enter"
    if is_loopback(ctx.settings.host):
        return "no key exists: everybody on this machine is an admin"
    return "no key exists, and --open was said: everybody who reaches it is an admin"


def configure(site: Any, host: str, port: int, census: Census) -> uvicorn.Config:
    """How uvicorn serves an ASGI application here."""
    return uvicorn.Config(
        site,
        host=host,
        port=port,
        log_config=None,
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=GRACE_S,
        http=cast("type[Protocol]", partial(BoundedHttpProtocol, census=census)),
        ws=BoundedWebSocketProtocol,
        ws_max_size=MAX_MESSAGE_BYTES,
        ws_per_message_deflate=False,
    )

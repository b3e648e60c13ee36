"""The demo building beside a running server."""

import logging
from threading import Event, Thread
from typing import Self

from tidemap.client import Client
from tidemap.demo import live
from tidemap.demo.seed import seed
from tidemap.services.context import Context
from tidemap.services.keys import create_key, delete_key, is_open

log = logging.getLogger(__name__)


class Demo:
    """The demo in a thread of its own, talking to the server as any robot does."""

    def __init__(self, ctx: Context, url: str) -> None:
        self._ctx, self._url = ctx, url
        self._stop = Event()
        self._key = None if is_open(ctx) else create_key(ctx, "demo", "admin")
        self._thread = Thread(target=self._run, name="tidemap-demo", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._stop.set()
        if self._key is not None:
            delete_key(self._ctx, self._key.id)

    def _run(self) -> None:
        try:
            with Client(self._url, key=self._key.key if self._key else None) as client:
                seed(client)
                print(f"The demo building is ready: {self._url}", flush=True)
                live.run(client, self._stop)
        except Exception:
            if not self._stop.is_set():
                log.exception("the demo failed; the server goes on")

"""overview: CPU of the server for the first page of a thousand locations, fifty of them, each with a model.

`first_ms` is the first page after a start, which reads the fifty models; `bytes` of the page as it is, not compressed.
"""

import time
from pathlib import Path
from tempfile import TemporaryDirectory

from anyio.from_thread import start_blocking_portal

from tests.api.house import Http
from tests.bench.timing import Figure
from tests.support.contexts import Clock, opened
from tests.support.databases import SqliteDatabases
from tests.support.thousand import fill
from tidemap.api.main import create_app
from tidemap_web.site import pages

MAX_MS = 50.0
ROUNDS = 20


def measure() -> Figure:
    clock = Clock()
    with TemporaryDirectory() as folder, SqliteDatabases(Path(folder)).migrated() as url:
        with opened(url, clock) as ctx:
            fill(ctx, clock.now, 50)
        with opened(url, clock) as ctx:
            app = create_app(ctx)
            with pages(ctx, app), start_blocking_portal() as portal:
                browser = Http(portal, app)
                first, *taken = (_asked_ms(browser) for _ in range(ROUNDS))
                size = len(browser.request("GET", "/").content)
    return Figure(min(taken), MAX_MS, 1.0, "ms CPU", {"first_ms": round(first, 1), "bytes": size})


def _asked_ms(browser: Http) -> float:
    started = time.process_time()
    browser.request("GET", "/")
    return 1e3 * (time.process_time() - started)

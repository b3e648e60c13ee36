"""The site: API, pages and viewer as one ASGI application on one port, with what runs beside them."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from fastapi import FastAPI
from starlette.staticfiles import StaticFiles

from app.api.main import create_app
from app.services.context import Context
from app.workers.updater import Updater
from web.pages import routes
from web.viewer import proxy
from web.viewer.server import ViewerServer

STATIC = Path(__file__).parent / "pages" / "static"


@contextmanager
def open_site(ctx: Context) -> Iterator[FastAPI]:
    """The application, its updater and viewer running."""
    with ExitStack() as stack:
        updater = Updater(ctx)
        updater.start()
        stack.callback(updater.stop)
        site = create_app(ctx, {"updater": updater.alive})
        site.mount("/static", StaticFiles(directory=STATIC), name="static")
        if ctx.settings.viewer:
            viewer = ViewerServer(ctx)
            viewer.start()
            stack.callback(viewer.stop)
            site.include_router(proxy.router(ctx, viewer))
        site.include_router(routes.router(ctx))
        yield site

"""The site: API, pages and viewer as one ASGI application on one port, with what runs beside them."""

from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from fastapi import FastAPI
from fastapi.openapi.docs import get_swagger_ui_html
from starlette.responses import HTMLResponse
from starlette.staticfiles import StaticFiles

from tidemap.api.main import BASE, create_app
from tidemap.services.context import Context
from tidemap.workers.compactor import Compactor
from tidemap.workers.election import LeaderElection
from tidemap.workers.updater import Updater
from tidemap_web.pages import routes
from tidemap_web.viewer import proxy
from tidemap_web.viewer.server import ViewerServer

STATIC = Path(__file__).parent / "pages" / "static"


@contextmanager
def open_site(ctx: Context) -> Iterator[FastAPI]:
    """The application, its workers and viewer running."""
    with ExitStack() as stack:
        election = LeaderElection(ctx)
        workers: dict[str, Updater | Compactor] = {
            "updater": Updater(ctx, election),
            "compactor": Compactor(ctx, election),
        }
        election.start()
        # Left after they have ended, for then others begin.
        stack.callback(election.stop)
        for worker in workers.values():
            worker.start()
            stack.callback(worker.stop)
        stack.callback(_tell_to_end, workers.values())
        alive = {name: worker.alive for name, worker in (workers | {"watch": election}).items()}
        site = create_app(ctx, alive, lambda: election.term is not None)
        site.mount("/static", StaticFiles(directory=STATIC), name="static")
        if ctx.settings.viewer:
            viewer = ViewerServer(ctx)
            viewer.start()
            stack.callback(viewer.stop)
            site.include_router(proxy.router(ctx, viewer))
        site.include_router(routes.router(ctx))
        site.add_api_route("/api/docs", _documentation, include_in_schema=False)
        yield site


def _tell_to_end(workers: Iterable[Updater | Compactor]) -> None:
    """All of them, before any is waited for: one may wait for another."""
    for worker in workers:
        worker.request_stop()


def _documentation() -> HTMLResponse:
    """The interactive documentation, with nothing from any other host."""
    swagger = "/static/vendor/swagger-ui"
    return get_swagger_ui_html(
        openapi_url=f"{BASE}/openapi.json",
        title="Tidemap: the API",
        swagger_js_url=f"{swagger}/swagger-ui-bundle.js",
        swagger_css_url=f"{swagger}/swagger-ui.css",
        swagger_favicon_url=f"{swagger}/favicon-32x32.png",
    )

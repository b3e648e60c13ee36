"""The site: what pages and viewer add to the API, on the same port."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fastapi import FastAPI
from fastapi.openapi.docs import get_swagger_ui_html
from starlette.responses import HTMLResponse
from starlette.staticfiles import StaticFiles

from tidemap.api.addresses import BASE
from tidemap.services.context import Context
from tidemap_web.pages import routes
from tidemap_web.viewer import proxy
from tidemap_web.viewer.server import ViewerServer

STATIC = Path(__file__).parent / "pages" / "static"


@contextmanager
def pages(ctx: Context, site: FastAPI) -> Iterator[None]:
    """Add the pages, the interactive documentation and, where the settings say so, the running viewer."""
    site.mount("/static", StaticFiles(directory=STATIC), name="static")
    site.include_router(routes.router(ctx))
    site.add_api_route("/api/docs", _documentation, include_in_schema=False)
    if not ctx.settings.viewer:
        yield
        return
    viewer = ViewerServer(ctx)
    viewer.start()
    try:
        site.include_router(proxy.router(ctx, viewer))
        yield
    finally:
        viewer.stop()


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

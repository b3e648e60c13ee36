"""The site: what pages and viewer add to the API, on the same port."""

from collections.abc import Iterator
from contextlib import contextmanager

from fastapi import FastAPI, Request, Response

from tidemap.api.addresses import BASE
from tidemap.services.context import Context
from tidemap_web.pages import assets, problems, routes
from tidemap_web.pages.templates import page
from tidemap_web.viewer import proxy
from tidemap_web.viewer.server import ViewerServer


@contextmanager
def pages(ctx: Context, site: FastAPI) -> Iterator[None]:
    """Add the pages, the interactive documentation and, where the settings say so, the running viewer."""
    site.include_router(assets.router())
    problems.install(site)
    site.include_router(routes.router(ctx))
    site.add_api_route("/api/docs", _documentation, include_in_schema=False, response_model=None)
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


def _documentation(request: Request) -> Response:
    """The interactive documentation, with nothing from any other host."""
    return page(request, "api_docs.html", {"openapi": f"{BASE}/openapi.json"})

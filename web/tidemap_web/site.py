"""The site: what pages and viewer add to the API, on the same port."""

from collections.abc import Iterator
from contextlib import contextmanager

from fastapi import FastAPI

from tidemap.services.context import Context
from tidemap_web.pages import api_docs, assets, problems, routes
from tidemap_web.viewer import proxy
from tidemap_web.viewer.server import ViewerServer


@contextmanager
def pages(ctx: Context, site: FastAPI) -> Iterator[None]:
    """Add the pages, the documentation of the API and, where the settings say so, the running viewer."""
    site.include_router(assets.router())
    problems.install(site)
    site.include_router(routes.router(ctx))
    site.include_router(api_docs.router(ctx, site.openapi))
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

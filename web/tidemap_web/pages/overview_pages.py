"""The list of locations, and the form of a new one."""

from dataclasses import replace

from fastapi import APIRouter, Request, Response

from tidemap.services.context import Context
from tidemap.services.overview import overview
from tidemap_web.pages import guard
from tidemap_web.pages.guarded import Facts, guarded, origin
from tidemap_web.pages.listing import PAGE, LocationList


def router(ctx: Context) -> APIRouter:
    """The first page and what leads on from it."""
    routes = APIRouter(include_in_schema=False)

    @routes.get("/", response_model=None)
    def index(request: Request) -> Response:
        """All locations."""
        return guarded(ctx, request, "locations.html", lambda: _locations(ctx, request))

    @routes.get("/fragments/locations", response_model=None)
    def table(request: Request) -> Response:
        """The table of locations alone, to refresh it."""
        return guarded(ctx, request, "locations_table.html", lambda: _locations(ctx, request))

    @routes.get("/new", response_model=None)
    def new_location(request: Request) -> Response:
        """The form of a new location, and what to post to it with."""
        return guarded(ctx, request, "new.html", lambda: origin(request))

    return routes


def _locations(ctx: Context, request: Request) -> Facts:
    wanted = LocationList.read(request.query_params)
    found = overview(ctx, replace(wanted.filter, scope=guard.scope_of(request)), wanted.offset, PAGE)
    return {
        "wanted": wanted,
        "rows": found.rows,
        "total": found.total,
        "pages": -(-found.total // PAGE),
        **origin(request),
    }

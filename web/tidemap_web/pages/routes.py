"""The pages for operators: the list of locations, one location, and signing in."""

import math
from collections.abc import Callable
from typing import Annotated, Any

from fastapi import APIRouter, Form, Request, Response
from fastapi.responses import RedirectResponse

from tidemap.errors import ForbiddenError, LocationNotFoundError, UnauthorizedError
from tidemap.services import anomalies, locations
from tidemap.services.context import Context
from tidemap_web.pages import guard
from tidemap_web.pages.templates import page

RECENT_S = 90 * 86400.0
EVENTS = 50
Facts = dict[str, Any]


def router(ctx: Context) -> APIRouter:
    """All pages but the viewer's."""
    routes = APIRouter(include_in_schema=False)

    @routes.get("/", response_model=None)
    def index(request: Request) -> Response:
        """All locations."""
        return _guarded(ctx, request, "locations.html", lambda: _locations(ctx, request))

    @routes.get("/fragments/locations", response_model=None)
    def locations_fragment(request: Request) -> Response:
        """The table of locations alone, to refresh it."""
        return _guarded(ctx, request, "locations_table.html", lambda: _locations(ctx, request))

    @routes.get("/locations/{name}", response_model=None)
    def location(request: Request, name: str) -> Response:
        """One location."""
        return _guarded(ctx, request, "location.html", lambda: {**_location(ctx, name), **_events(ctx, name)})

    @routes.get("/fragments/locations/{name}", response_model=None)
    def facts_fragment(request: Request, name: str) -> Response:
        """A location's facts alone, to refresh them."""
        return _guarded(ctx, request, "location_facts.html", lambda: _location(ctx, name))

    @routes.get("/fragments/locations/{name}/anomalies", response_model=None)
    def anomalies_fragment(request: Request, name: str) -> Response:
        """A location's anomalies alone, to refresh them."""
        return _guarded(ctx, request, "anomalies_table.html", lambda: _events(ctx, name))

    _add_session(ctx, routes)
    return routes


def _add_session(ctx: Context, routes: APIRouter) -> None:
    @routes.get("/login", response_model=None)
    def login(request: Request, next: str = "/") -> Response:
        """The form that asks for a key; who needs none goes straight on."""
        if guard.refuse(request) is None:
            return RedirectResponse(guard.local(next), 303, guard.NO_STORE)
        return _login_page(ctx, request, next)

    @routes.post("/login", response_model=None)
    def sign_in(request: Request, key: Annotated[str, Form()], next: Annotated[str, Form()] = "/") -> Response:
        """Take a key and remember the browser."""
        try:
            return guard.sign_in(ctx, request, key.strip(), guard.local(next))
        except UnauthorizedError:
            return _login_page(ctx, request, next, "This key is not known here. Check that all of it was copied.")
        except ForbiddenError as error:
            return _login_page(ctx, request, next, str(error))

    @routes.post("/logout", response_model=None)
    def sign_out(request: Request) -> Response:
        """End the browser's session."""
        return guard.sign_out(ctx, request)


def _login_page(ctx: Context, request: Request, then: str, problem: str | None = None) -> Response:
    facts = {**guard.header(ctx, request), "next": guard.local(then), "problem": problem}
    return page(request, "login.html", facts, status=401 if problem else 200)


def _guarded(ctx: Context, request: Request, template: str, facts: Callable[[], Facts]) -> Response:
    """The page for who may look; 404 in words for a location that is not there."""
    if turned_away := guard.redirect(request):
        return turned_away
    header = guard.header(ctx, request)
    try:
        return page(request, template, {**header, **facts()})
    except LocationNotFoundError as error:
        problem = {**header, "title": error.title, "detail": str(error)}
        return page(request, "problem.html", problem, status=404)


def _locations(ctx: Context, request: Request) -> Facts:
    return {
        "locations": locations.list_locations(ctx),
        "now": ctx.clock(),
        "origin": str(request.base_url).rstrip("/"),
    }


def _location(ctx: Context, name: str) -> Facts:
    place = locations.get_location(ctx, name)
    return {"place": place, "now": ctx.clock(), "cells": math.prod(place.shape)}


def _events(ctx: Context, name: str) -> Facts:
    """The newest events, newest first."""
    place = locations.get_location(ctx, name)
    since = (place.last_time or 0.0) - RECENT_S
    found = anomalies.list_events(ctx, anomalies.EventQuery(location=name, start=since, limit=None))
    return {
        "place": place,
        "now": ctx.clock(),
        "events": found[: -EVENTS - 1 : -1],
        "more": len(found) > EVENTS,
    }

"""The pages for operators: the list of locations, one location, and signing in."""

from collections.abc import Callable
from typing import Any

from fastapi import APIRouter, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import RedirectResponse

from tidemap.errors import DomainError, UnauthorizedError
from tidemap.services import anomalies, locations
from tidemap.services.context import Context
from tidemap_web.pages import guard
from tidemap_web.pages.problems import Refusal, problem_page, refusal_of
from tidemap_web.pages.sign_in import sign_in_form
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
        return _guarded(ctx, request, "location.html", lambda: _whole(ctx, request, name))

    @routes.get("/fragments/locations/{name}", response_model=None)
    def facts_fragment(request: Request, name: str) -> Response:
        """A location's facts alone, to refresh them."""
        return _guarded(ctx, request, "location_facts.html", lambda: _location(ctx, request, name))

    @routes.get("/fragments/locations/{name}/anomalies", response_model=None)
    def anomalies_fragment(request: Request, name: str) -> Response:
        """A location's anomalies alone, to refresh them."""
        return _guarded(ctx, request, "anomalies_table.html", lambda: _events(ctx, request, name))

    _add_session(ctx, routes)
    return routes


def _add_session(ctx: Context, routes: APIRouter) -> None:
    @routes.get("/login", response_model=None)
    def login(request: Request, next: str = "/") -> Response:
        """The form that asks for a key; who needs none goes straight on."""
        try:
            if guard.refuse(request) is None:
                return RedirectResponse(guard.local(next), 303, guard.NO_STORE)
            return _login_page(ctx, request, next)
        except DomainError as error:
            return problem_page(request, error)

    @routes.post("/login", response_model=None)
    async def sign_in(request: Request) -> Response:
        """Take a key and remember the browser. Whatever is wrong is said on the form."""
        then = "/"
        try:
            sent = await sign_in_form(request)
            then = guard.local(sent.next)
            return await run_in_threadpool(guard.sign_in, ctx, request, sent.key, then)
        except UnauthorizedError:
            problem = "This key is not known here. Check that all of it was copied."
            return await run_in_threadpool(_login_page, ctx, request, then, Refusal(401, problem))
        except DomainError as error:
            return await run_in_threadpool(_login_page, ctx, request, then, refusal_of(error))

    @routes.post("/logout", response_model=None)
    def sign_out(request: Request) -> Response:
        """End the browser's session."""
        try:
            return guard.sign_out(ctx, request)
        except DomainError as error:
            return problem_page(request, error)


def _login_page(ctx: Context, request: Request, then: str, refusal: Refusal | None = None) -> Response:
    problem = None if refusal is None else refusal.detail
    facts = {**guard.header(ctx, request), "next": guard.local(then), "problem": problem}
    answer = page(request, "login.html", facts, status=200 if refusal is None else refusal.status)
    if refusal is not None:
        answer.headers.update(refusal.headers)
    return answer


def _guarded(ctx: Context, request: Request, template: str, facts: Callable[[], Facts]) -> Response:
    """The page for who may look; what is wrong is said on a page too."""
    try:
        if redirected := guard.redirect(request):
            return redirected
        return page(request, template, {**guard.header(ctx, request), **facts()})
    except DomainError as error:
        return problem_page(request, error)


def _locations(ctx: Context, request: Request) -> Facts:
    return {
        "locations": locations.list_locations(ctx, scope=guard.scope_of(request)),
        "now": ctx.clock(),
        "origin": str(request.base_url).rstrip("/"),
    }


def _whole(ctx: Context, request: Request, name: str) -> Facts:
    return {**_location(ctx, request, name), **_events(ctx, request, name)}


def _location(ctx: Context, request: Request, name: str) -> Facts:
    guard.check_location(request, name)
    location = locations.get_location(ctx, name)
    return {"location": location, "now": ctx.clock(), "cells": location.n_cells}


def _events(ctx: Context, request: Request, name: str) -> Facts:
    """The newest events, newest first."""
    guard.check_location(request, name)
    location = locations.get_location(ctx, name)
    since = (location.last_time or 0.0) - RECENT_S
    found = anomalies.list_events(ctx, anomalies.EventQuery(location=name, start=since, limit=None))
    return {
        "location": location,
        "now": ctx.clock(),
        "events": found[: -EVENTS - 1 : -1],
        "more": len(found) > EVENTS,
    }

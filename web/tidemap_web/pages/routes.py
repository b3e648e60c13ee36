"""The pages for operators: the list of locations, one location, and signing in."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from fastapi import APIRouter, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import RedirectResponse

from tidemap.errors import DomainError, UnauthorizedError
from tidemap.scope import Scope
from tidemap.services import locations
from tidemap.services.anomalies import Anomaly, EventQuery, newest_events
from tidemap.services.context import Context
from tidemap.services.jobs import list_jobs
from tidemap.services.keys import OPEN
from tidemap.services.overview import overview, silent_at
from tidemap.services.posters import posters
from tidemap.storage.records import LocationRecord
from tidemap_web.pages import guard, words
from tidemap_web.pages.listing import PAGE, AnomalyList, LocationList
from tidemap_web.pages.problems import Refusal, problem_page, refusal_of
from tidemap_web.pages.sign_in import sign_in_form
from tidemap_web.pages.templates import page

JOBS = 5
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

    @routes.get("/anomalies", response_model=None)
    def anomalies(request: Request) -> Response:
        """The anomalies of all locations."""
        return _guarded(ctx, request, "anomalies.html", lambda: _anomalies(ctx, request))

    @routes.get("/fragments/anomalies", response_model=None)
    def all_anomalies_fragment(request: Request) -> Response:
        """Their table alone, to refresh it."""
        return _guarded(ctx, request, "anomalies_table.html", lambda: _anomalies(ctx, request))

    @routes.get("/locations/{name}", response_model=None)
    def location(request: Request, name: str) -> Response:
        """One location."""
        return _guarded(ctx, request, "location.html", lambda: _whole(ctx, request, name))

    @routes.get("/fragments/locations/{name}", response_model=None)
    def facts_fragment(request: Request, name: str) -> Response:
        """A location's facts alone, to refresh them."""
        return _guarded(ctx, request, "location_facts.html", lambda: _location(ctx, request, name))

    @routes.get("/fragments/locations/{name}/work", response_model=None)
    def work_fragment(request: Request, name: str) -> Response:
        """A location's jobs and robots alone, to refresh them."""
        return _guarded(ctx, request, "location_work.html", lambda: _work(ctx, request, name))

    @routes.get("/new", response_model=None)
    def new_location(request: Request) -> Response:
        """The form of a new location, and what to post to it with."""
        return _guarded(ctx, request, "new.html", lambda: _origin(request))

    @routes.get("/fragments/locations/{name}/anomalies", response_model=None)
    def anomalies_fragment(request: Request, name: str) -> Response:
        """A location's anomalies alone, to refresh them."""
        return _guarded(ctx, request, "anomalies_table.html", lambda: _listed_of(ctx, request, name))

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
    wanted = LocationList.of(request.query_params)
    found = overview(ctx, replace(wanted.filter, scope=guard.scope_of(request)), wanted.offset, PAGE)
    return {
        "wanted": wanted,
        "rows": found.rows,
        "total": found.total,
        "pages": -(-found.total // PAGE),
        **_origin(request),
    }


def _origin(request: Request) -> Facts:
    """What examples need: the server's address, and whether it wants a key."""
    return {"origin": str(request.base_url).rstrip("/"), "keyed": guard.principal(request) != OPEN}


def _anomalies(ctx: Context, request: Request) -> Facts:
    wanted = AnomalyList.of(request.query_params)
    start = ctx.clock() - wanted.days * words.DAY_S if wanted.days else None
    query = EventQuery(
        limit=PAGE + 1,
        start=start,
        min_surprise=wanted.surprise,
        acknowledged=wanted.acknowledged,
        search=wanted.q,
        scope=guard.scope_of(request),
    )
    return {"wanted": wanted, **_listed(newest_events(ctx, query, wanted.before))}


def _listed(found: list[tuple[LocationRecord, Anomaly]]) -> Facts:
    return {"events": found[:PAGE], "more": len(found) > PAGE}


def _whole(ctx: Context, request: Request, name: str) -> Facts:
    return {**_work(ctx, request, name), **_location(ctx, request, name), **_events(ctx, request, name)}


def _location(ctx: Context, request: Request, name: str) -> Facts:
    guard.check_location(request, name)
    location = locations.get_location(ctx, name)
    return {"location": location, "cells": location.n_cells, "silent_at": silent_at(location)}


def _work(ctx: Context, request: Request, name: str) -> Facts:
    guard.check_location(request, name)
    found = locations.find_location(ctx, name)
    jobs = list_jobs(ctx, None, JOBS, Scope((name,)))
    return {"location": found, "jobs": jobs, "posters": posters(ctx, name)}


def _listed_of(ctx: Context, request: Request, name: str) -> Facts:
    events = _events(ctx, request, name)
    return {"location": locations.find_location(ctx, name), **events}


def _events(ctx: Context, request: Request, name: str) -> Facts:
    """The newest events, newest first."""
    guard.check_location(request, name)
    return _listed(newest_events(ctx, EventQuery(location=name, limit=PAGE + 1)))

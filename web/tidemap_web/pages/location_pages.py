"""One location: its page, and the parts of it that are brought up to date."""

from fastapi import APIRouter, Request, Response

from tidemap.scope import Scope
from tidemap.services import locations
from tidemap.services.context import Context
from tidemap.services.jobs import list_jobs
from tidemap.services.overview import silent_since
from tidemap.services.posters import posters
from tidemap_web.pages import guard
from tidemap_web.pages.anomaly_pages import anomalies_of
from tidemap_web.pages.guarded import Facts, guarded

JOBS = 5


def router(ctx: Context) -> APIRouter:
    """The page and its parts."""
    routes = APIRouter(include_in_schema=False)

    @routes.get("/locations/{name}", response_model=None)
    def location(request: Request, name: str) -> Response:
        """The whole page."""
        return guarded(ctx, request, "location.html", lambda: _whole(ctx, request, name))

    @routes.get("/fragments/locations/{name}", response_model=None)
    def facts(request: Request, name: str) -> Response:
        """The facts alone."""
        return guarded(ctx, request, "location_facts.html", lambda: _facts(ctx, request, name))

    @routes.get("/fragments/locations/{name}/work", response_model=None)
    def work(request: Request, name: str) -> Response:
        """Jobs and robots alone."""
        return guarded(ctx, request, "location_work.html", lambda: _work(ctx, request, name))

    @routes.get("/fragments/locations/{name}/anomalies", response_model=None)
    def anomalies(request: Request, name: str) -> Response:
        """The anomalies alone."""
        return guarded(ctx, request, "anomalies_table.html", lambda: _anomalies(ctx, request, name))

    return routes


def _whole(ctx: Context, request: Request, name: str) -> Facts:
    return {**_work(ctx, request, name), **_facts(ctx, request, name), **anomalies_of(ctx, request, name)}


def _facts(ctx: Context, request: Request, name: str) -> Facts:
    guard.check_location(request, name)
    location = locations.get_location(ctx, name)
    return {"location": location, "cells": location.n_cells, "silent_since": silent_since(ctx, location)}


def _work(ctx: Context, request: Request, name: str) -> Facts:
    guard.check_location(request, name)
    found = locations.find_location(ctx, name)
    return {"location": found, "jobs": list_jobs(ctx, None, JOBS, Scope((name,))), "posters": posters(ctx, name)}


def _anomalies(ctx: Context, request: Request, name: str) -> Facts:
    found = anomalies_of(ctx, request, name)
    return {"location": locations.find_location(ctx, name), **found}

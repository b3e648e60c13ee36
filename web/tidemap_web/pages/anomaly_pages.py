"""The anomalies of all locations, or of one."""

from collections.abc import Sequence

from fastapi import APIRouter, Request, Response

from tidemap.services.anomalies import Anomaly, EventQuery, newest_events
from tidemap.services.context import Context
from tidemap.storage.records import LocationRecord
from tidemap_web.pages import guard, words
from tidemap_web.pages.guarded import Facts, guarded
from tidemap_web.pages.listing import PAGE, AnomalyList


def router(ctx: Context) -> APIRouter:
    """The page of anomalies."""
    routes = APIRouter(include_in_schema=False)

    @routes.get("/anomalies", response_model=None)
    def anomalies(request: Request) -> Response:
        """The page."""
        return guarded(ctx, request, "anomalies.html", lambda: _anomalies(ctx, request))

    @routes.get("/fragments/anomalies", response_model=None)
    def table(request: Request) -> Response:
        """The table alone, to refresh it."""
        return guarded(ctx, request, "anomalies_table.html", lambda: _anomalies(ctx, request))

    return routes


def anomalies_of(ctx: Context, request: Request, name: str) -> Facts:
    """The newest events of a location, whatever became of them; older ones are on the page of anomalies."""
    guard.check_location(request, name)
    return _listed(newest_events(ctx, EventQuery(location=name, limit=PAGE + 1)), AnomalyList(of=name, state="all"))


def _anomalies(ctx: Context, request: Request) -> Facts:
    wanted = AnomalyList.read(request.query_params)
    if wanted.of is not None:
        guard.check_location(request, wanted.of)
    query = EventQuery(
        location=wanted.of,
        limit=PAGE + 1,
        start=ctx.clock() - wanted.days * words.DAY_S if wanted.days else None,
        min_surprise=wanted.surprise,
        acknowledged=wanted.acknowledged,
        search=wanted.q,
        scope=guard.scope_of(request),
    )
    return {"wanted": wanted, **_listed(newest_events(ctx, query, wanted.before), wanted)}


def _listed(found: Sequence[tuple[LocationRecord, Anomaly]], wanted: AnomalyList) -> Facts:
    """The events, and the query of those before them where there are any."""
    events = found[:PAGE]
    return {"events": events, "older": wanted.older(events[-1][1].id) if len(found) > PAGE else None}

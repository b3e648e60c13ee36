"""The API as one ASGI application."""

from collections.abc import Callable, Mapping
from typing import Any

from anyio import CapacityLimiter
from fastapi import FastAPI
from starlette.middleware.cors import CORSMiddleware

from tidemap.api import errors, live, openapi
from tidemap.api.addresses import BASE
from tidemap.api.budget import Budget
from tidemap.api.compression import AnswerCompression
from tidemap.api.limits import Limits, Senders
from tidemap.api.metrics import Listeners, RequestMetrics, count_refused, make_registry
from tidemap.api.privacy import Privacy
from tidemap.api.request_log import RequestLog
from tidemap.api.routers import (
    anomalies,
    audit,
    events,
    export,
    health,
    jobs,
    keys,
    locations,
    maps,
    mutes,
    observations,
    scans,
    webhooks,
)
from tidemap.api.state import AppState
from tidemap.api.unchanged import Unchanged, hear_of_changes
from tidemap.services.context import Context
from tidemap.version import __version__

ROUTERS = tuple(
    each.router
    for each in (locations, observations, scans, maps, export, anomalies, jobs, keys, audit, webhooks, mutes)
)
CROSS_ORIGIN: dict[str, Any] = {
    "allow_methods": ("GET", "POST", "PATCH", "DELETE"),
    "allow_headers": ("Authorization", "Content-Type", "Idempotency-Key", "If-None-Match", "Last-Event-ID"),
    "expose_headers": ("ETag", "Location", "Retry-After", "Last-Event-ID", "Tidemap-Revision", "X-Request-ID"),
}
"""What pages of the sites in the settings may send and read; never with a cookie of this server."""
LONG_QUESTIONS = 4
"""Questions that compute for long at once; more wait."""
_SUMMARY = "A map service for robots that live in one place for months."
_DESCRIPTION = (
    "Post what robots saw; ask for the state of every cell at any time, past or future, with a confidence; be told "
    "what is abnormal. Times in: Unix seconds or ISO 8601 with a zone. Lengths in metres. Unknown fields and unknown "
    "query parameters are errors. Errors are problem documents (RFC 9457). Every answer names its request in "
    "X-Request-ID; text and JSON are compressed as Accept-Encoding allows."
)


def create_app(
    ctx: Context,
    alive: Mapping[str, Callable[[], bool]] | None = None,
    is_leader: Callable[[], bool] = lambda: False,
) -> FastAPI:
    """The API over a context; `alive` says what runs in the background (for /readyz), `is_leader` whether here."""
    app = FastAPI(
        title="Tidemap",
        summary=_SUMMARY,
        description=_DESCRIPTION,
        version=__version__,
        openapi_url=None,
        docs_url=None,
        redoc_url=None,
        license_info={"name": "BSD-3-Clause", "identifier": "BSD-3-Clause"},
    )
    alive, changes = alive or {}, ctx.store.changes
    metrics = make_registry(ctx, is_leader, alive)
    app.state.tidemap = AppState(
        ctx=ctx,
        alive=alive,
        budget=Budget(ctx.settings.max_parsing_bytes),
        limits=Limits.of(ctx.settings),
        senders=Senders(),
        metrics=metrics,
        refused=count_refused(metrics),
        listeners=Listeners(metrics),
        long_questions=CapacityLimiter(LONG_QUESTIONS),
    )
    app.add_middleware(AnswerCompression)
    app.add_middleware(Privacy)
    hear_of_changes(ctx.bus, changes)
    app.add_middleware(Unchanged, changes=changes, hears=alive.get("relay", lambda: False))
    app.add_middleware(RequestMetrics, registry=metrics)
    if ctx.settings.cors_origins:
        app.add_middleware(CORSMiddleware, allow_origins=ctx.settings.cors_origins, **CROSS_ORIGIN)
    app.add_middleware(RequestLog, access_log=ctx.settings.access_log)
    errors.install(app)
    for router in ROUTERS:
        app.include_router(router, prefix=BASE)
    app.include_router(events.router, prefix=BASE)
    app.include_router(live.router, prefix=BASE)
    app.include_router(health.router)
    openapi.install(app)
    return app

"""The API as one ASGI application."""

from collections.abc import Callable, Mapping
from http import HTTPStatus
from typing import Any

from anyio import CapacityLimiter
from fastapi import FastAPI
from fastapi.responses import JSONResponse

from tidemap.api import errors, live
from tidemap.api.addresses import BASE
from tidemap.api.budget import Budget
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
    observations,
    scans,
    webhooks,
)
from tidemap.api.state import AppState
from tidemap.media_types import PROBLEM
from tidemap.schemas.common import Problem
from tidemap.schemas.maps import EvaluateForm, PredictForm
from tidemap.schemas.observations import GridObservations, StateObservations
from tidemap.schemas.scans import RangesScan, ScanHeader
from tidemap.services.context import Context
from tidemap.version import __version__

ROUTERS = tuple(
    each.router for each in (locations, observations, scans, maps, export, anomalies, jobs, keys, audit, webhooks)
)
_REASONS = {
    400: "The body cannot be read.",
    401: "A key is needed.",
    403: "The key's role does not allow this.",
    404: "Unknown location, cell, scan, job, anomaly or key.",
    409: "Conflict: the name is taken, the idempotency key was used, or there is no revision yet (`no-model`).",
    413: "The unpacked body is too large.",
    415: "The media type is not read here.",
    422: "Readable but wrong; `errors` names the fields and what to change.",
    429: "Too many requests; try again after `Retry-After` seconds.",
    500: "What is asked for is stored, and damaged (`corrupt-chunk`); the server's log says more.",
    503: "Shutting down or busy; try again after `Retry-After` seconds.",
}
_KINDS = {
    400: "unreadable-body",
    401: "unauthorized",
    403: "forbidden",
    404: "location-not-found",
    409: "name-taken",
    413: "body-too-large",
    415: "unsupported-media-type",
    422: "invalid-input",
    429: "rate-limit",
    500: "corrupt-chunk",
    503: "queue-full",
}
_OWN_FORMS = (StateObservations, GridObservations, ScanHeader, RangesScan, PredictForm, EvaluateForm)
"""Forms that routes read by themselves."""
LONG_QUESTIONS = 4
"""Questions that compute for long at once; more wait."""
_SUMMARY = "A map service for robots that live in one place for months."
_DESCRIPTION = (
    "Post what robots saw; ask for the state of every cell at any time, past or future, with a confidence; be told "
    "what is abnormal. Times in: Unix seconds or ISO 8601 with a zone. Lengths in metres. Unknown fields and unknown "
    "query parameters are errors. Errors are problem documents (RFC 9457)."
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
    metrics = make_registry(ctx, is_leader)
    app.state.tidemap = AppState(
        ctx=ctx,
        alive=alive or {},
        budget=Budget(ctx.settings.max_parsing_bytes),
        limits=Limits.of(ctx.settings),
        senders=Senders(),
        metrics=metrics,
        refused=count_refused(metrics),
        listeners=Listeners(metrics),
        long_questions=CapacityLimiter(LONG_QUESTIONS),
    )
    app.add_middleware(Privacy)
    app.add_middleware(RequestMetrics, registry=metrics)
    app.add_middleware(RequestLog, access_log=ctx.settings.access_log)
    errors.install(app)
    for router in ROUTERS:
        app.include_router(router, prefix=BASE, responses=_problems())
    app.include_router(events.router, prefix=BASE, responses=_problems())
    app.include_router(live.router, prefix=BASE)
    app.include_router(health.router)
    _document(app)
    return app


_HEADERS = {401: "WWW-Authenticate", 429: "Retry-After", 503: "Retry-After"}


def _problems() -> dict[int | str, dict[str, Any]]:
    return {status: _problem(status, reason) for status, reason in _REASONS.items()}


def _problem(status: int, reason: str) -> dict[str, Any]:
    example: dict[str, Any] = {
        "type": f"urn:tidemap:problem:{_KINDS[status]}",
        "title": HTTPStatus(status).phrase,
        "status": status,
        "detail": reason,
        "instance": f"{BASE}/locations/office-door",
    }
    if status == HTTPStatus.UNPROCESSABLE_ENTITY:
        example["errors"] = [{"field": "time[3]", "message": "NaN and infinity are no times; give Unix seconds"}]
    schema = {"$ref": "#/components/schemas/Problem"}
    answer: dict[str, Any] = {
        "description": reason,
        "content": {PROBLEM: {"schema": schema, "example": example}},
    }
    if status in _HEADERS:
        answer["headers"] = {_HEADERS[status]: {"schema": {"type": "string"}}}
    return answer


def _document(app: FastAPI) -> None:
    """The OpenAPI document, with the forms that routes parse by themselves, and the key.

    FastAPI would make it on the event loop, where others wait for it.
    """
    generate = app.openapi

    def complete() -> dict[str, Any]:
        if app.openapi_schema is None:
            document = generate()
            parts = document.setdefault("components", {})
            schemas = parts.setdefault("schemas", {})
            for form in (*_OWN_FORMS, Problem):
                schema = form.model_json_schema(ref_template="#/components/schemas/{model}")
                schemas.update(schema.pop("$defs", {}))
                schemas[form.__name__] = schema
            parts["securitySchemes"] = {"key": {"type": "http", "scheme": "bearer", "bearerFormat": "tm_…"}}
            document["security"] = [{"key": []}, {}]
        return app.openapi_schema or {}

    app.openapi = complete  # type: ignore[method-assign]

    @app.get(f"{BASE}/openapi.json", include_in_schema=False)
    def openapi() -> JSONResponse:
        return JSONResponse(complete())

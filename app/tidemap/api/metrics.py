"""Metrics that count what happens: requests by route and status, messages, commits, jobs, and who listens."""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from http import HTTPMethod

from prometheus_client import (
    CollectorRegistry,
    Counter,
    Gauge,
    Histogram,
    Info,
    PlatformCollector,
    ProcessCollector,
    disable_created_metrics,
)
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from tidemap.api.addresses import BASE
from tidemap.api.collectors import ContextCollector
from tidemap.events.messages import EventMessage
from tidemap.events.subscription import KINDS
from tidemap.media_types import EVENT_STREAM
from tidemap.services.context import Context
from tidemap.version import __version__

# A series beside each counter that says when it began: nobody asks, and there are as many of them as of counters.
disable_created_metrics()  # type: ignore[no-untyped-call]

ENDED = ("done", "failed", "cancelled")
"""States of a job that has ended."""
METHODS = frozenset(HTTPMethod)
"""Methods that get a label of their own; a sender may invent as many others as it likes."""


STREAMED = EVENT_STREAM.encode()
"""Answers without end: how long they took says nothing."""


def make_registry(
    ctx: Context, is_leader: Callable[[], bool] = lambda: False, alive: Mapping[str, Callable[[], bool]] | None = None
) -> CollectorRegistry:
    """A registry fed by the bus; `is_leader` says whether this process does the background work, `alive` what runs."""
    registry = CollectorRegistry()
    ProcessCollector(registry=registry)
    PlatformCollector(registry=registry)
    Info("tidemap_build", "The version that runs.", registry=registry).info({"version": __version__})
    registry.register(ContextCollector(ctx))
    leads = Gauge("tidemap_background", "1 where the background work of the database is done.", registry=registry)
    leads.set_function(is_leader)
    up = Gauge("tidemap_worker_up", "1 where a part that runs in the background does.", ["worker"], registry=registry)
    for name, check in (alive or {}).items():
        up.labels(name).set_function(check)
    commits = Histogram("tidemap_commit_seconds", "Time that a group of writes took to be durable.", registry=registry)
    ctx.store.on_commit(commits.observe)
    _count_messages(ctx, registry)
    return registry


def _count_messages(ctx: Context, registry: CollectorRegistry) -> None:
    measurements = Counter("tidemap_measurements", "Measurements stored.", registry=registry)
    events = Counter("tidemap_events", "Messages by kind.", ["kind"], registry=registry)
    jobs = Counter("tidemap_jobs", "Jobs that ended here, by state.", ["state"], registry=registry)
    for kind in KINDS:
        events.labels(kind)
    for state in ENDED:
        jobs.labels(state)

    def count(message: EventMessage) -> None:
        events.labels(message.kind).inc()
        if message.kind == "observation":
            measurements.inc(message.data["measurements"])
        elif message.kind == "job" and message.data.get("state") in ENDED:
            jobs.labels(message.data["state"]).inc()

    # Of this process alone, so that those of several can be added up.
    ctx.bus.subscribe_own(count)


def count_refused(registry: CollectorRegistry) -> Counter:
    """A counter of requests that were refused for now, by the kind of the problem."""
    return Counter("tidemap_refused", "Requests refused for now (429, 503) by problem.", ["problem"], registry=registry)


class Listeners:
    """Who listens to events, by transport (`websocket`, `sse`), how many were dropped, and how long messages wait."""

    def __init__(self, registry: CollectorRegistry) -> None:
        self._open = Gauge("tidemap_listeners", "Open streams of events.", ["transport"], registry=registry)
        self._dropped = Counter(
            "tidemap_listeners_dropped", "Readers of events that did not keep up.", ["transport"], registry=registry
        )
        self._lag = Histogram(
            "tidemap_event_lag_seconds",
            "Time from a message to its reader's turn to get it.",
            ["transport"],
            registry=registry,
        )
        for transport in ("websocket", "sse"):
            self._open.labels(transport)
            self._dropped.labels(transport)
            self._lag.labels(transport)

    @contextmanager
    def count(self, transport: str) -> Iterator[None]:
        """One more, until the end of the block."""
        with self._open.labels(transport).track_inprogress():
            yield

    def lag(self, transport: str) -> Callable[[float], None]:
        """Takes the seconds that a message waited for a reader."""
        return self._lag.labels(transport).observe

    def drop(self, transport: str) -> None:
        """One did not keep up."""
        self._dropped.labels(transport).inc()


class RequestMetrics:
    """ASGI middleware: duration by route, method and status."""

    def __init__(self, app: ASGIApp, registry: CollectorRegistry) -> None:
        self._app = app
        self._duration = Histogram(
            "tidemap_request_seconds",
            "Time from the request's head to the end of the answer.",
            ["method", "route", "status"],
            registry=registry,
        )

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        started, status, endless = time.perf_counter(), 500, False

        async def watch(message: Message) -> None:
            nonlocal status, endless
            if message["type"] == "http.response.start":
                status = message["status"]
                endless = any(
                    name == b"content-type" and value.startswith(STREAMED) for name, value in message["headers"]
                )
            await send(message)

        try:
            await self._app(scope, receive, watch)
        finally:
            if not endless:
                self._note(scope, status, time.perf_counter() - started)

    def _note(self, scope: Scope, status: int, seconds: float) -> None:
        route = route_of(scope)
        method = scope["method"] if scope["method"] in METHODS else "other"
        self._duration.labels(method, route, str(status)).observe(seconds)


def route_of(scope: Scope) -> str:
    """The template of the path that was asked for, `other` where there is none.

    >>> from types import SimpleNamespace
    >>> route_of({"path": "/api/v1/jobs/3", "route": SimpleNamespace(path="/jobs/{job_id}")})
    '/api/v1/jobs/{job_id}'
    """
    route: str | None = getattr(scope.get("route"), "path", None)
    if route is None:
        return "other"
    # A router knows its paths without what it is mounted under, and a location has a page of the same path.
    base = BASE if scope["path"].startswith(f"{BASE}/") else ""
    return base + route.removeprefix(base)

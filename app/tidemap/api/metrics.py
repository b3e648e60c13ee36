"""Metrics: requests by route and status, the commit queue, observations and anomalies."""

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from http import HTTPMethod

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.registry import Collector
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from tidemap.events.messages import EventMessage
from tidemap.media_types import EVENT_STREAM
from tidemap.services.context import Context

METHODS = frozenset(HTTPMethod)
"""Methods that get a label of their own; a sender may invent as many others as it likes."""


STREAMED = EVENT_STREAM.encode()
"""Answers without end: how long they took says nothing."""


class ContextCollector(Collector):
    """The commit queue and what is known to be damaged, read when asked for."""

    def __init__(self, ctx: Context) -> None:
        self._ctx = ctx

    def collect(self) -> Iterable[GaugeMetricFamily]:
        """Gauges."""
        yield GaugeMetricFamily("tidemap_commit_queue", "Writes that wait for the writer.", self._ctx.store.waiting())
        yield GaugeMetricFamily("tidemap_damaged_blobs", "Stored blobs found corrupt.", self._ctx.damage.count())


def make_registry(ctx: Context, is_leader: Callable[[], bool] = lambda: False) -> CollectorRegistry:
    """A registry fed by the bus; `is_leader` says whether this process does the background work."""
    registry = CollectorRegistry()
    registry.register(ContextCollector(ctx))
    leads = Gauge("tidemap_background", "1 where the background work of the database is done.", registry=registry)
    leads.set_function(is_leader)
    measurements = Counter("tidemap_measurements", "Measurements stored.", registry=registry)
    events = Counter("tidemap_events", "Messages by kind.", ["kind"], registry=registry)

    def count(message: EventMessage) -> None:
        events.labels(message.kind).inc()
        if message.kind == "observation":
            measurements.inc(message.data["measurements"])

    # Of this process alone, so that those of several can be added up.
    ctx.bus.subscribe_own(count)
    return registry


def count_refused(registry: CollectorRegistry) -> Counter:
    """A counter of requests that were refused for now, by the kind of the problem."""
    return Counter("tidemap_refused", "Requests refused for now (429, 503) by problem.", ["problem"], registry=registry)


class Listeners:
    """Who listens to events, by transport (`websocket`, `sse`), and how many were dropped."""

    def __init__(self, registry: CollectorRegistry) -> None:
        self._open = Gauge("tidemap_listeners", "Open streams of events.", ["transport"], registry=registry)
        self._dropped = Counter(
            "tidemap_listeners_dropped", "Readers of events that did not keep up.", ["transport"], registry=registry
        )
        for transport in ("websocket", "sse"):
            self._open.labels(transport)
            self._dropped.labels(transport)

    @contextmanager
    def count(self, transport: str) -> Iterator[None]:
        """One more, until the end of the block."""
        with self._open.labels(transport).track_inprogress():
            yield

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
        route = getattr(scope.get("route"), "path", "other")
        method = scope["method"] if scope["method"] in METHODS else "other"
        self._duration.labels(method, route, str(status)).observe(seconds)

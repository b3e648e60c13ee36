"""State: what the requests of one application share, as one typed object."""

from asyncio import Task
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from threading import Event

from anyio import CapacityLimiter
from prometheus_client import CollectorRegistry, Counter
from starlette.applications import Starlette
from starlette.requests import HTTPConnection

from tidemap.api.budget import Budget
from tidemap.api.limits import Limits, Senders
from tidemap.api.metrics import Listeners
from tidemap.services.context import Context
from tidemap.services.keys import Principal

KeyChecks = dict[tuple[str | None, str | None], Task[Principal]]


@dataclass(frozen=True, slots=True, kw_only=True)
class AppState:
    """`alive` says what runs in the background and whether it is at work; `refused` counts refusals by their code.

    `long_questions` are answered a few at a time. `stopping` is set when the server begins to stop. `key_checks` are
    those of keys and sessions that sockets share, by what was sent.
    """

    ctx: Context
    alive: Mapping[str, Callable[[], bool]]
    budget: Budget
    limits: Limits
    senders: Senders
    metrics: CollectorRegistry
    refused: Counter
    listeners: Listeners
    long_questions: CapacityLimiter
    stopping: Event = field(default_factory=Event)
    key_checks: KeyChecks = field(default_factory=dict)


def state_of(connection: HTTPConnection) -> AppState:
    """The state of the application that a request or WebSocket is for."""
    return state_of_app(connection.app)


def state_of_app(app: Starlette) -> AppState:
    """The state of an application."""
    state: AppState = app.state.tidemap
    return state

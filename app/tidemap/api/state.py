"""State: what the requests of one application share, as one typed object."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from prometheus_client import CollectorRegistry, Counter
from starlette.requests import HTTPConnection

from tidemap.api.budget import Budget
from tidemap.api.limits import Limits, Senders
from tidemap.services.context import Context


@dataclass(frozen=True, slots=True, kw_only=True)
class AppState:
    """`alive` says what runs in the background and whether it is at work; `refused` counts refusals by their code."""

    ctx: Context
    alive: Mapping[str, Callable[[], bool]]
    budget: Budget
    limits: Limits
    senders: Senders
    metrics: CollectorRegistry
    refused: Counter


def state_of(connection: HTTPConnection) -> AppState:
    """The state of the application that a request or WebSocket is for."""
    state: AppState = connection.app.state.tidemap
    return state

"""The kinds of process: all in one, an API replica, a worker. Pages come as an argument, so that this knows none."""

import signal
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from threading import Event

from fastapi import FastAPI

from tidemap.api.main import create_app
from tidemap.server.ending import end_within
from tidemap.server.warming import warm_up
from tidemap.services.context import Context
from tidemap.workers.compactor import Compactor
from tidemap.workers.election import LeaderElection
from tidemap.workers.relay import relayed
from tidemap.workers.updater import Updater
from tidemap.workers.watcher import Watcher
from tidemap.workers.webhooks import WebhookSender

Extension = Callable[[Context, FastAPI], AbstractContextManager[None]]
"""Adds routes to the application and runs what they need, for as long as the process serves."""


@dataclass(frozen=True, slots=True)
class Background:
    """The workers of this process: whether each is alive, and whether this process is the leader."""

    alive: dict[str, Callable[[], bool]]
    is_leader: Callable[[], bool]


@contextmanager
def background(ctx: Context) -> Iterator[Background]:
    """Updater, compactor, watcher and the sender of webhooks, which work while this process is the leader."""
    election = LeaderElection(ctx)
    workers: dict[str, Updater | Compactor | Watcher | WebhookSender] = {
        "updater": Updater(ctx, election),
        "compactor": Compactor(ctx, election),
        "watcher": Watcher(ctx, election),
        "webhooks": WebhookSender(ctx, election),
    }
    with ExitStack() as stack:
        election.start()
        # The election stops last: another process begins as soon as it does.
        stack.callback(election.stop)
        for worker in workers.values():
            worker.start()
            stack.callback(worker.stop)
        # All are asked to stop before any is waited for: one may wait for another.
        for worker in workers.values():
            stack.callback(worker.request_stop)
        alive = {name: worker.alive for name, worker in (workers | {"watch": election}).items()}
        yield Background(alive, lambda: election.term is not None)


@contextmanager
def all_in_one(ctx: Context, *extensions: Extension) -> Iterator[FastAPI]:
    """API and extensions with the workers beside them."""
    with relayed(ctx) as relay, background(ctx) as beside:
        app = create_app(ctx, relay | beside.alive, beside.is_leader)
        with _extended(ctx, app, extensions):
            yield app


@contextmanager
def api_replica(ctx: Context, *extensions: Extension) -> Iterator[FastAPI]:
    """API and extensions alone; another process on the same database does the background work."""
    with relayed(ctx) as relay:
        app = create_app(ctx, relay)
        with _extended(ctx, app, extensions):
            yield app


def work(ctx: Context, stop: Event) -> None:
    """Background work alone, until `stop` is set: a candidate for leadership that serves nothing.

    The whole process ends within `max_stop_s` then.
    """
    warm_up()
    with relayed(ctx), background(ctx):
        stop.wait()
        end_within(ctx.settings.max_stop_s, ctx.store.waiting)


def stop_on_signals() -> Event:
    """An event that SIGTERM and SIGINT set."""
    stop = Event()
    for asked in (signal.SIGTERM, signal.SIGINT):
        signal.signal(asked, lambda *_: stop.set())
    return stop


@contextmanager
def _extended(ctx: Context, app: FastAPI, extensions: tuple[Extension, ...]) -> Iterator[None]:
    with ExitStack() as stack:
        for extension in extensions:
            stack.enter_context(extension(ctx, app))
        yield

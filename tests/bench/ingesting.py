"""What a posted look costs a server, beside the same body answered with an empty 201 by a route of the same site."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

from tests.bench import lab
from tests.bench.databases import OpenDatabase
from tests.bench.load import Target, floor_server, request
from tests.bench.timing import Figure, quantile
from tests.support.contexts import Clock, opened
from tests.support.server import ServerProcess
from tidemap.media_types import ARROW

CONNECTIONS, POSTS, ROUNDS = 16, 400, 5
PATH = f"/api/v1/locations/{lab.NAME}/observations"
ENVIRONMENT = {"TIDEMAP_UPDATER": "false", "TIDEMAP_VIEWER": "false", "TIDEMAP_LOG_LEVEL": "warning"}


def figure(database: OpenDatabase, posts: int = POSTS, rounds: int = ROUNDS) -> Figure:
    """Processor time of the server alone; its updater rests, for what it does is not done for each post."""
    clock = Clock(lab.now())
    bodies = lab.bodies(min(posts, 128), clock.now)
    with database() as url, tempfile.TemporaryDirectory(prefix="tidemap-bench-") as folder, _floors() as floors:
        with opened(url, clock) as ctx:
            lab.prepare(ctx)
        server = ServerProcess(Path(folder), database_url=url, env=ENVIRONMENT)
        try:
            return _measure(Target(server.process.pid, server.port), floors, bodies, posts, rounds)
        finally:
            server.stop()


@contextmanager
def _floors() -> Iterator[tuple[Target, Target]]:
    """A server with an empty route of the site, and one with nothing but an ASGI function."""
    with floor_server("site") as site, floor_server("bare") as bare:
        yield site, bare


def _measure(target: Target, floors: tuple[Target, Target], bodies: list[bytes], posts: int, rounds: int) -> Figure:
    numbers = count()

    def batch(path: str) -> list[bytes]:
        keys = (f"{next(numbers):032x}" for _ in range(posts))
        return [
            request("POST", path, bodies[i % len(bodies)], content_type=ARROW, idempotency_key=key)
            for i, key in enumerate(keys)
        ]

    everyone = ((target, PATH), *((floor, "/floor") for floor in floors))
    for each, path in everyone:
        each.serve(batch(path), CONNECTIONS)
    served = [[each.serve(batch(path), CONNECTIONS) for each, path in everyone] for _ in range(rounds)]
    posted, answered, _ = zip(*served, strict=True)
    cpu, floor_cpu, bare_cpu = (min(each.cpu_s for each in column) * 1e6 for column in zip(*served, strict=True))
    latency = [seconds for each in posted for seconds in each.latency_s]
    details: dict[str, float | int | str] = {
        "cells": lab.N_SEEN,
        "connections": CONNECTIONS,
        "body_bytes": len(bodies[0]),
        "bare_floor": round(bare_cpu),
        "posts_per_s": round(posts / min(each.wall_s for each in posted)),
        "p50_ms": round(quantile(latency, 0.5) * 1e3, 1),
        "p99_ms": round(quantile(latency, 0.99) * 1e3, 1),
        "floor_p50_ms": round(quantile([s for each in answered for s in each.latency_s], 0.5) * 1e3, 1),
    }
    return Figure(cpu, floor_cpu, 2.5, "µs CPU/post", details)

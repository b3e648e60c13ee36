"""What a posted look costs a server, beside the same body answered by an empty 201."""

import tempfile
from itertools import count
from pathlib import Path

from app.ingest.observation import ARROW
from tests.bench import lab
from tests.bench.databases import OpenDatabase
from tests.bench.load import Target, floor_server, request
from tests.bench.timing import Figure, quantile
from tests.support.contexts import Clock, opened
from tests.support.server import ServerProcess

CONNECTIONS, POSTS, ROUNDS = 16, 400, 5
PATH = f"/api/v1/locations/{lab.NAME}/observations"
ENVIRONMENT = {"TIDEMAP_UPDATER": "false", "TIDEMAP_VIEWER": "false", "TIDEMAP_LOG_LEVEL": "warning"}


def figure(database: OpenDatabase, posts: int = POSTS, rounds: int = ROUNDS) -> Figure:
    """Processor time of the server alone; its updater rests, for what it does is not done for each post."""
    clock = Clock(lab.now())
    bodies = lab.bodies(min(posts, 128), clock.now)
    with database() as url, tempfile.TemporaryDirectory(prefix="tidemap-bench-") as folder, floor_server() as floor:
        with opened(url, clock) as ctx:
            lab.prepare(ctx)
        server = ServerProcess(Path(folder), database_url=url, env=ENVIRONMENT)
        try:
            return _measure(Target(server.process.pid, server.port), floor, bodies, posts, rounds)
        finally:
            server.stop()


def _measure(target: Target, floor: Target, bodies: list[bytes], posts: int, rounds: int) -> Figure:
    numbers = count()

    def batch() -> list[bytes]:
        keys = (f"{next(numbers):032x}" for _ in range(posts))
        return [
            request("POST", PATH, bodies[i % len(bodies)], content_type=ARROW, idempotency_key=key)
            for i, key in enumerate(keys)
        ]

    target.serve(batch(), CONNECTIONS)
    pairs = [(floor.serve(batch(), CONNECTIONS), target.serve(batch(), CONNECTIONS)) for _ in range(rounds)]
    latency = [seconds for _, served in pairs for seconds in served.latency_s]
    fastest = min(served.wall_s for _, served in pairs)
    details: dict[str, float | int | str] = {
        "cells": lab.N_SEEN,
        "connections": CONNECTIONS,
        "body_bytes": len(bodies[0]),
        "posts_per_s": round(posts / fastest),
        "p50_ms": round(quantile(latency, 0.5) * 1e3, 1),
        "p99_ms": round(quantile(latency, 0.99) * 1e3, 1),
        "floor_p50_ms": round(quantile([s for served, _ in pairs for s in served.latency_s], 0.5) * 1e3, 1),
    }
    least = (min(served.cpu_s for served in column) for column in zip(*pairs, strict=True))
    floor_cpu, cpu = (seconds * 1e6 for seconds in least)
    return Figure(cpu, floor_cpu, 2.5, "µs CPU/post", details)

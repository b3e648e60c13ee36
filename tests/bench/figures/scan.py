"""scan: a sweep of 70,000 points from its body to the commit, registered by the map, one at a time, SQLite."""

import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from tests.bench import sweep
from tests.bench.timing import Figure, interleaved
from tidemap.api.scan_body import read_scan
from tidemap.client.scanning import scan
from tidemap.formats.scan_body import ScanBody
from tidemap.ingest.registration import register
from tidemap.ingest.scan import scan_of
from tidemap.services.context import Context, open_context
from tidemap.services.locations import NewLocation, create_location, find_location
from tidemap.services.observe import judged
from tidemap.services.posts import Post
from tidemap.services.registering import register_scan, timed_scan
from tidemap.services.scans import begin_scan
from tidemap.services.spectra import fitted
from tidemap.services.surfaces import Block, surface_at
from tidemap.services.update import UpdateRequest, run_update
from tidemap.settings import Settings
from tidemap.storage.store import prepare_database
from tidemap.workers.executors import LocalExecutor

NAME, INTERVAL_S = "hall", 300.0
STATED = np.diag(np.repeat([0.04**2, np.radians(2.0) ** 2], 3))
WRONG = np.array([0.03, -0.02, 0.01])
"""How far the stated position is off, in metres."""


def body(time_s: float, wrong: np.ndarray, **said: object) -> ScanBody:
    """The sweep as a client sends it."""
    points = (sweep.points() - sweep.ORIGIN).astype(np.float32)
    pose = [*(sweep.ORIGIN + wrong), 0.0, 0.0, 0.0, 1.0]
    post = scan("", points, pose, time_s, source=None, key=None, max_range=sweep.MAX_RANGE_M, **said)
    (batch,) = post.batches()
    return ScanBody(batch.content, batch.content_type)


def post(ctx: Context, sent: ScanBody) -> str:
    """Store a scan; its verdict."""
    stored = begin_scan(ctx, NAME, Post(sent, idempotency_key=uuid.uuid4().hex), partial(read_scan, sent)).result()
    assert stored.scan is not None
    return stored.scan.verdict


@contextmanager
def hall() -> Iterator[Context]:
    """A location that has seen the sweep for an hour, with a model."""
    with TemporaryDirectory() as folder:
        settings = Settings(data=Path(folder), updater=False)
        prepare_database(settings.url)
        with open_context(settings) as ctx:
            prepare(ctx)
            yield ctx


def prepare(ctx: Context) -> None:
    """Make the location, post the sweep for an hour, and fit its model."""
    new = NewLocation(name=NAME, interval_s=INTERVAL_S, kind="grid3d", grid=sweep.GRID, estimator="static", min_cells=8)
    create_location(ctx, new)
    for ago in range(1, 13):
        post(ctx, body(ctx.clock() - INTERVAL_S * ago, np.zeros(3)))
    run_update(ctx, find_location(ctx, NAME).id, UpdateRequest(), LocalExecutor(ctx, 1), lambda _: None)


def measure() -> Figure:
    """Floor: its rays cast from the stated pose, and nothing else. Both are counted in time of the processor, after the
    first scan of a sample, which makes the surface that is expected (`first_ms`)."""
    with hall() as ctx:
        now = ctx.clock()
        sent = [body(now - i * 1e-3, WRONG, covariance=STATED) for i in range(8)]
        started = time.process_time()
        assert post(ctx, sent.pop()) == "accepted"
        first_s = time.process_time() - started
        queue = iter(sent)
        read = scan_of(read_scan(sent[0]), sweep.GRID)
        work = (lambda: post(ctx, next(queue)), lambda: read.cast(sweep.GRID))
        whole_s, floor_s = interleaved(*work, rounds=5, clock=time.process_time)
        return Figure(
            whole_s * 1e3, floor_s * 1e3, 6.0, "ms", {"first_ms": round(first_s * 1e3), **parts(ctx, sent[0])}
        )


def parts(ctx: Context, sent: ScanBody) -> dict[str, float | int | str]:
    """What each step takes, alone, in milliseconds."""
    location = find_location(ctx, NAME)
    read = read_scan(sent)
    asked = timed_scan(location, read)
    model = fitted(ctx, NAME)
    surface = surface_at(ctx, model, Block.of(asked.scan, model.location.cells), asked.time)
    registered = register_scan(ctx, location, asked)
    steps = {
        "parse_ms": lambda: timed_scan(location, read_scan(ScanBody(sent.content, sent.media_type))),
        "register_ms": lambda: register(asked.scan, surface),
        "cast_ms": lambda: asked.scan.cast(sweep.GRID),
        "judge_and_pack_ms": lambda: judged(ctx, Post(sent), location, registered.seen),
    }
    taken = interleaved(*steps.values(), rounds=5, clock=time.process_time)
    found: dict[str, float | int | str] = {
        name: round(seconds * 1e3, 1) for name, seconds in zip(steps, taken, strict=True)
    }
    return {**found, "points": len(asked.scan.points), "cells": len(registered.seen), "surface_cells": surface.n_points}

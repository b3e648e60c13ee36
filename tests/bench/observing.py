"""What one observation costs in this process, from its body to its durable commit, beside storing the same bytes."""

import time
from threading import Event

from tests.bench import lab
from tests.bench.databases import OpenDatabase, OpenRaw
from tests.bench.timing import Figure, interleaved
from tests.support.contexts import Clock, opened
from tests.support.parsing import Target, parse
from tidemap.formats.registry import Body
from tidemap.media_types import ARROW
from tidemap.services.context import Context
from tidemap.services.observe import begin
from tidemap.services.posts import Post
from tidemap.space.grid import GridGeometry
from tidemap.storage.blobs import pack_measurements

BATCH, ROUNDS = 100, 9


def figure(database: OpenDatabase, raw: OpenRaw, rounds: int = ROUNDS) -> Figure:
    """Floor: the bodies as they are, `raw`; `packed`: only what is left of them when packed."""
    clock = Clock(lab.now())
    bodies = lab.bodies(BATCH, clock.now)
    payloads = [packed(body, clock.now) for body in bodies]
    with database() as url, opened(url, clock, commit_batch=BATCH) as ctx, raw(url) as insert:
        lab.prepare(ctx)
        posting = Posting(ctx, bodies)
        work = (lambda: insert(bodies), lambda: insert(payloads), posting.post)
        floor, small, value = interleaved(*work, rounds=rounds)
        cpu_floor, cpu_small, cpu = interleaved(*work, rounds=rounds, clock=time.process_time)
    micro = 1e6 / BATCH
    details: dict[str, float | int | str] = {
        "cells": lab.N_SEEN,
        "batch": BATCH,
        "body_bytes": len(bodies[0]),
        "packed_bytes": sum(map(len, payloads)) // BATCH,
        "cpu": round(cpu * micro),
        "cpu_floor": round(cpu_floor * micro),
        "packed_floor": round(small * micro, 1),
        "packed_cpu_floor": round(cpu_small * micro, 1),
    }
    return Figure(value * micro, floor * micro, 2.0, "µs/observation", details)


class Posting:
    """Posts the same looks again and again, each time under new keys."""

    def __init__(self, ctx: Context, bodies: list[bytes]) -> None:
        self._ctx, self._bodies = ctx, bodies
        self._posts = 0

    def post(self) -> None:
        """Begin all while the writer is held, so that it commits them in one group, and wait for all."""
        begun = Event()
        self._ctx.store.submit(lambda _: begun.wait())
        pending = [begin(self._ctx, lab.NAME, self._post(body)) for body in self._bodies]
        begun.set()
        for each in pending:
            each.result()

    def _post(self, body: bytes) -> Post:
        self._posts += 1
        return Post(Body(body, ARROW), "robot", f"{self._posts:032x}")


def packed(body: bytes, latest: float) -> bytes:
    """What the log keeps of a body."""
    target = Target(GridGeometry("map", (0.0, 0.0, 0.0), 0.1, lab.SHAPE), latest)
    return pack_measurements(parse(Body(body, ARROW), target))

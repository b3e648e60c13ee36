"""What a server would still compile once it is warm: `python -m tests.support.compiled URL`, on an empty database."""

import json
import sys
from collections.abc import Iterator
from functools import partial

import numpy as np
from numba.core.dispatcher import Dispatcher

from tests.bench import lab
from tests.support.contexts import Clock, compact_now, make_location, opened, post_states, refit
from tidemap.formats.registry import Body
from tidemap.media_types import ARROW
from tidemap.services.detect import DetectQuery, detect
from tidemap.services.observe import observe
from tidemap.services.posts import Post
from tidemap.services.predict import PredictQuery, predict_at
from tidemap.services.scans import begin_scan
from tidemap.services.state import StateQuery, state_at
from tidemap.services.warm import warm
from tidemap.storage.store import migrate_database


def signatures() -> Iterator[str]:
    """Every kernel with the types it is compiled for."""
    for name, module in sorted(sys.modules.items()):
        if name.startswith("tidemap."):
            for kernel in vars(module).values():
                if isinstance(kernel, Dispatcher):
                    yield from (f"{kernel.py_func.__qualname__}{types}" for types in kernel.signatures)


def work(url: str) -> None:
    """What robots, the compactor, the updater and dashboards have a server do."""
    clock = Clock(lab.now())
    with opened(url, clock) as ctx:
        lab.prepare(ctx)
        for ago_s in (0.0, 2.0, 600.0, 602.0, 10.0):
            observe(ctx, lab.NAME, Post(Body(lab.seen(clock.now - ago_s), ARROW)))
            compact_now(ctx, lab.NAME)
        refit(ctx, lab.NAME)
        begin_scan(ctx, lab.NAME, Post(Body(b"", "")), partial(lab.scan, clock.now)).result()
        detect(ctx, lab.NAME, DetectQuery(clock.now - lab.DAY_S, clock.now))
        state_at(ctx, lab.NAME, StateQuery(clock.now, given="observations"))
        make_location(ctx, "door")
        make_location(ctx, "gate", sensor="learn")
        for name in ("door", "gate"):
            minute = np.arange(3000)
            post_states(ctx, name, clock.now - 60.0 * (3000 - minute), minute % 1440 < 500)
            refit(ctx, name)
            post_states(ctx, name, [clock.now], [1])
            compact_now(ctx, name)
            refit(ctx, name)
            state_at(ctx, name, StateQuery(clock.now, given="observations"))
            predict_at(ctx, name, PredictQuery([clock.now, clock.now + 60], given="observations"))


if __name__ == "__main__":
    migrate_database(sys.argv[1])
    warm()
    before = set(signatures())
    work(sys.argv[1])
    print(json.dumps(sorted(set(signatures()) - before)))

"""observed: the state of 10^6 known cells with what was last seen of each, in Arrow, against the same without.

`rhythm` and `rhythm_floor` are the same given the model alone, as the viewer asks. `post_ms` and `next_ms` are the CPU
of a post of four cells in four chunks, judged and committed, and of the question after it; `first_ms` of the first one.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from math import prod

import numpy as np

from tests.bench import databases, million
from tests.bench.timing import Figure, interleaved
from tests.support.contexts import Clock, opened
from tidemap.api.encoding import encode_answer
from tidemap.client import arrow
from tidemap.client.encoding import snapshot
from tidemap.formats.registry import Body
from tidemap.media_types import ARROW
from tidemap.services.context import Context
from tidemap.services.given import Given
from tidemap.services.locations import find_location
from tidemap.services.observe import observe
from tidemap.services.posts import Post
from tidemap.services.state import StateQuery
from tidemap.services.state import ask as asking
from tidemap.services.update import UpdateRequest, run_update
from tidemap.workers.executors import LocalExecutor

NOW = float(million.TIME[-1]) + 1.0
POSTS = 8


def measure(shape: tuple[int, ...] = million.SHAPE) -> Figure:
    with hall(shape) as ctx:
        ask(ctx, "observations")
        first_s = cpu_s(lambda: ask(ctx, "observations", observed=True))
        floor, value, rhythm_floor, rhythm = interleaved(
            *(partial(ask, ctx, given, observed=observed) for given, observed in QUESTIONS),
            clock=time.process_time,
        )
        post_s, next_s = posted(ctx, prod(shape))
    details: dict[str, float | int | str] = {"cells": prod(shape)}
    taken = {"first": first_s, "rhythm": rhythm, "rhythm_floor": rhythm_floor, "post": post_s, "next": next_s}
    details |= {f"{name}_ms": round(1e3 * seconds, 1) for name, seconds in taken.items()}
    return Figure(value * 1e3, floor * 1e3, 2.0, "ms CPU", details)


QUESTIONS: tuple[tuple[Given, bool], ...] = (
    ("observations", False),
    ("observations", True),
    ("model", False),
    ("model", True),
)


@contextmanager
def hall(shape: tuple[int, ...]) -> Iterator[Context]:
    """The hall with its model, at the end of its history."""
    with databases.sqlite() as url, opened(url, Clock(NOW)) as ctx:
        million.make(ctx, shape, "fft")
        executor = LocalExecutor(ctx, ctx.settings.update_threads)
        request = UpdateRequest(order=5)
        run_update(ctx, find_location(ctx, million.NAME).id, request, executor, lambda _: None)
        executor.close()
        yield ctx


def ask(ctx: Context, given: Given, observed: bool = False, at: float = NOW) -> None:
    """The whole map, as it is sent."""
    encode_answer(ctx, asking(ctx, million.NAME, StateQuery(at, given=given, observed=observed)), ARROW)


def posted(ctx: Context, n_cells: int) -> tuple[float, float]:
    """CPU of a post of four cells, and of the question after it: the least of some."""
    taken = []
    for n in range(1, 1 + POSTS):
        at = NOW + million.INTERVAL_S * n
        cells = (np.arange(4) * (n_cells // 4) + n).astype(np.uint32)
        body = Body(arrow.write(snapshot(at, cells[:2], cells[2:]).named()), ARROW)
        post_s = cpu_s(partial(observe, ctx, million.NAME, Post(body)))
        taken.append((post_s, cpu_s(partial(ask, ctx, "model", observed=True, at=at))))
    return min(taken, key=sum)


def cpu_s(work: Callable[[], object]) -> float:
    started = time.process_time()
    work()
    return time.process_time() - started

"""A hall of 10^6 cells, a week of five-minute samples each, a tenth of them changing, put into a database directly."""

from collections.abc import Iterator
from functools import partial
from itertools import islice
from math import prod

import numpy as np

from tidemap.client import arrow
from tidemap.client.encoding import snapshot
from tidemap.formats.registry import Body
from tidemap.history.chunks import CHUNK_CELLS
from tidemap.history.history import History
from tidemap.history.segment import SEGMENT_SAMPLES, Segment
from tidemap.media_types import ARROW
from tidemap.services.context import Context
from tidemap.services.locations import NewLocation, create_location, find_location
from tidemap.services.observe import observe
from tidemap.services.posts import Post
from tidemap.space.grid import GridGeometry
from tidemap.storage.blobs import pack_segment
from tidemap.storage.records import LocationRecord
from tidemap.storage.repositories.segments import SegmentKey
from tidemap.storage.work import Work

NAME, SHAPE, INTERVAL_S, N_SAMPLES = "hall", (200, 200, 25), 300.0, 2016
NOISE, EVERY = 0.02, 10
TIME = INTERVAL_S * np.arange(N_SAMPLES, dtype=np.float64)


def make(ctx: Context, shape: tuple[int, ...] = SHAPE, estimator: str = "auto") -> None:
    """The location with its compacted history, as if looks at all of it had been posted; not yet updated."""
    grid = GridGeometry("map", (0.0, 0.0, 0.0), 0.1, shape)
    form = NewLocation(name=NAME, kind="grid3d", interval_s=INTERVAL_S, epoch=0.0, grid=grid, estimator=estimator)
    create_location(ctx, form)
    location = find_location(ctx, NAME)
    for some in _groups(_segments(prod(shape)), 32):
        ctx.store.write(partial(put, location, some))
    for time in (TIME[0], TIME[-1]):
        observe(
            ctx, NAME, Post(Body(arrow.write(snapshot(time, np.zeros(0, np.uint32), np.array([1])).named()), ARROW))
        )


def put(location: LocationRecord, some: dict[SegmentKey, bytes], work: Work) -> None:
    """Store some segments."""
    work.segments.put(location, some)


def _segments(n_cells: int) -> Iterator[tuple[SegmentKey, bytes]]:
    for chunk, first in enumerate(range(0, n_cells, CHUNK_CELLS)):
        history = History.from_states(states(first, min(n_cells, first + CHUNK_CELLS)))
        yield (chunk, 0), pack_segment(Segment(history.window(0, SEGMENT_SAMPLES), TIME, None))


def _groups(items: Iterator[tuple[SegmentKey, bytes]], size: int) -> Iterator[dict[SegmentKey, bytes]]:
    while some := dict(islice(items, size)):
        yield some


def states(first: int, stop: int) -> np.ndarray:
    """(stop - first, N_SAMPLES) of some cells: every tenth is occupied for some hours of every day and is seen
    wrongly now and then; the others are always free, or, every seventh, always occupied."""
    random = np.random.default_rng(first)
    cell = np.arange(first, stop)
    states = np.repeat((cell % 7 == 0).astype(np.uint8)[:, np.newaxis], N_SAMPLES, axis=1)
    changing = np.flatnonzero(cell % EVERY == 1)
    hour, n = TIME / 3600 % 24, (changing.size, 1)
    begin, length = random.uniform(0, 24, n), random.uniform(2, 12, n)
    wrong = random.random((changing.size, N_SAMPLES), np.float32) < NOISE
    states[changing] = ((hour - begin) % 24 < length) ^ wrong
    return states

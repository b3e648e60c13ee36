"""A laboratory that robots look at: 10^5 cells; a look sees 10^4, and a tenth of them change by the day."""

import time

import numpy as np

from tidemap.client import arrow
from tidemap.client.encoding import snapshot
from tidemap.formats.registry import Body
from tidemap.ingest.scan import SentScan
from tidemap.media_types import ARROW
from tidemap.schemas.scans import ScanHeader
from tidemap.services.context import Context
from tidemap.services.locations import NewLocation, create_location, find_location
from tidemap.services.observe import observe
from tidemap.services.posts import Post
from tidemap.services.update import UpdateRequest, run_update
from tidemap.space.grid import GridGeometry
from tidemap.workers.executors import LocalExecutor

NAME, SHAPE, INTERVAL_S, DAY_S = "lab", (100, 100, 10), 300.0, 86_400.0
BOX = (slice(15, 75), slice(25, 75), slice(0, 5))
CELLS = np.arange(np.prod(SHAPE), dtype=np.uint32).reshape(SHAPE)[BOX].ravel()
N_SEEN, NOISE = 10_000, 0.005
LEARNED_LOOKS = 96


def seen(time_s: float, n_seen: int = N_SEEN) -> bytes:
    """The body of a look: first the cells seen occupied, then those seen free, as the client sends them.

    Every look misses other cells of the box, and sees 0.5 % of its cells wrongly.
    """
    random = np.random.default_rng(int(time_s))
    rows = np.sort(random.choice(CELLS.size, n_seen, replace=False))
    occupied = _occupied(time_s)[rows] ^ (random.random(n_seen) < NOISE)
    return arrow.write(snapshot(time_s, CELLS[rows[occupied]], CELLS[rows[~occupied]]).named())


def scan(time_s: float) -> SentScan:
    """A scan from the middle of the box, a metre around."""
    directions = np.random.default_rng(int(time_s)).normal(size=(1000, 3))
    points = directions / np.linalg.norm(directions, axis=1)[:, np.newaxis]
    header = ScanHeader(time=time_s, map_from_sensor=[4.5, 5.0, 0.5, 0.0, 0.0, 0.0, 1.0])
    return SentScan(header, points.astype(np.float32))


def bodies(count: int, before_s: float) -> list[bytes]:
    """Looks, two seconds apart, the last at `before_s`."""
    return [seen(before_s - 2.0 * (count - i)) for i in range(count)]


def prepare(ctx: Context, name: str = NAME) -> None:
    """Make the location, post eight days of looks two hours apart, and fit its first model."""
    grid = GridGeometry("map", (0.0, 0.0, 0.0), 0.1, SHAPE)
    create_location(
        ctx,
        NewLocation(name=name, kind="grid3d", interval_s=INTERVAL_S, estimator="fft", order=5, min_cells=4, grid=grid),
    )
    until = ctx.clock() - 2 * INTERVAL_S
    for i in range(LEARNED_LOOKS):
        observe(ctx, name, Post(Body(seen(until - 7200.0 * (LEARNED_LOOKS - i)), ARROW)))
    executor = LocalExecutor(ctx, 2)
    run_update(ctx, find_location(ctx, name).id, UpdateRequest(), executor, lambda _: None)
    executor.close()


def _occupied(time_s: float) -> np.ndarray:
    """A tenth is occupied for some hours of every day, another tenth always."""
    location = np.arange(CELLS.size) // 50
    hour = time_s % DAY_S / 3600
    begin = location // 10 % 16
    return np.where(location % 10 == 0, (hour >= begin) & (hour < begin + 8), location % 10 == 1)


def now() -> float:
    """Half past nine this morning in UTC or yesterday's: a moment at which nothing that changes is changing."""
    today = time.time() // DAY_S * DAY_S
    return today - DAY_S + 9.5 * 3600

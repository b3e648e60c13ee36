"""year_update: a server updates 10^4 changing cells, a year of five-minute samples each; floor: reading their rows."""

import sqlite3
import tempfile
import time
import zlib
from functools import partial
from pathlib import Path

import numpy as np
import zstandard

from tests.bench.databases import sqlite
from tests.bench.figures.year import year_of_cells
from tests.bench.million import put
from tests.bench.timing import Figure
from tests.support.contexts import opened
from tests.support.memory import memory_mb, peak_memory_mb
from tests.support.server import ServerProcess
from tidemap.client import Client, arrow
from tidemap.client.encoding import snapshot
from tidemap.formats.registry import Body
from tidemap.history.chunks import CHUNK_CELLS
from tidemap.history.segment import SEGMENT_SAMPLES, Segment
from tidemap.media_types import ARROW
from tidemap.services.context import Context
from tidemap.services.locations import NewLocation, create_location, find_location
from tidemap.services.observe import observe
from tidemap.services.posts import Post
from tidemap.space.grid import GridGeometry
from tidemap.storage.blobs import pack_segment
from tidemap.storage.codec import HEADERS

BY_NAME = True
"""Takes minutes."""
NAME, SHAPE, INTERVAL_S = "house", (40, 32, 8), 300.0
ENVIRONMENT = {"TIDEMAP_UPDATER": "false", "TIDEMAP_VIEWER": "false", "TIDEMAP_LOG_LEVEL": "warning"}


def measure(shape: tuple[int, int, int] = SHAPE) -> Figure:
    """The memory is what the server's process takes beyond what it has when it is ready."""
    with sqlite() as url, tempfile.TemporaryDirectory(prefix="tidemap-bench-") as folder:
        with opened(url) as ctx:
            prepare(ctx, shape)
        floor = read(Path(url.removeprefix("sqlite:///")))
        server = ServerProcess(Path(folder), database_url=url, env=ENVIRONMENT)
        try:
            before = memory_mb(server.process.pid)
            started = time.perf_counter()
            with Client(server.url) as client:
                job = client.location(NAME).update(wait=True)
                location = client.location(NAME).get()
            took = time.perf_counter() - started
            peak = peak_memory_mb(server.process.pid)
        finally:
            server.stop()
    assert location.first_time is not None
    assert location.last_time is not None
    details: dict[str, float | int | str] = {
        "state": job.state,
        "cells": int(np.prod(shape)),
        "samples": int((location.last_time - location.first_time) / INTERVAL_S) + 1,
        "peak_mb": round(peak - before),
    }
    return Figure(took, floor, 100.0, "s", details)


def prepare(ctx: Context, shape: tuple[int, int, int]) -> None:
    """Every chunk is whole and has the same history."""
    grid = GridGeometry("map", (0.0, 0.0, 0.0), 0.1, shape)
    form = NewLocation(name=NAME, kind="grid3d", interval_s=INTERVAL_S, epoch=0.0, grid=grid, estimator="calendar")
    create_location(ctx, form)
    location = find_location(ctx, NAME)
    year = year_of_cells(CHUNK_CELLS)
    for number in range(-(-year.n_samples // SEGMENT_SAMPLES)):
        start = number * SEGMENT_SAMPLES
        part = year.window(start, start + SEGMENT_SAMPLES)
        times = INTERVAL_S * np.arange(start, min(year.n_samples, start + SEGMENT_SAMPLES), dtype=np.float64)
        blob = pack_segment(Segment(part, times, None))
        some = {(chunk, number): blob for chunk in range(location.n_chunks)}
        ctx.store.write(partial(put, location, some))
    for time_s in (0.0, (year.n_samples - 1) * INTERVAL_S):
        observe(
            ctx, NAME, Post(Body(arrow.write(snapshot(time_s, np.zeros(0, np.uint32), np.array([1])).named()), ARROW))
        )


def read(path: Path) -> float:
    """Seconds to read, check and decompress all rows of the history once."""
    started = time.perf_counter()
    connection = sqlite3.connect(path)
    decompressor = zstandard.ZstdDecompressor(dict_data=HEADERS)
    for (payload,) in connection.execute("SELECT payload FROM history"):
        frame = memoryview(payload)[5:]
        zlib.crc32(frame)
        decompressor.decompress(frame)
    connection.close()
    return time.perf_counter() - started

"""million: loading the spectra of 10^6 cells, a tenth changing, against reading and decompressing their rows."""

import sqlite3
import time
import zlib
from collections.abc import Callable
from pathlib import Path

import zstandard

from tests.bench import databases, million
from tests.bench.timing import Figure, interleaved
from tests.support.contexts import opened
from tidemap.services.context import Context
from tidemap.services.locations import find_location
from tidemap.services.series import SeriesQuery, series
from tidemap.services.spectra import fitted
from tidemap.services.update import UpdateRequest, run_update
from tidemap.storage.codec import HEADERS
from tidemap.workers.executors import LocalExecutor

HEADER = 5
"""Bytes of a blob before its zstd frame."""


def measure(shape: tuple[int, ...] = million.SHAPE) -> Figure:
    with databases.sqlite() as url:
        with opened(url) as ctx:
            million.make(ctx, shape)
            update_s = seconds(lambda: update(ctx))
        path = Path(url.removeprefix("sqlite:///"))
        with opened(url, spectrum_cache_bytes=0, history_cache_bytes=0) as ctx:
            work = (lambda: raw(path), lambda: fitted(ctx, million.NAME))
            floor, load = interleaved(*work, rounds=5)
            spectrum = fitted(ctx, million.NAME)
        with opened(url, history_cache_bytes=0) as ctx:
            series(ctx, million.NAME)
            numbers = iter(range(0, spectrum.location.n_cells, spectrum.location.n_cells // 50))
            one = min(seconds(lambda: series(ctx, million.NAME, SeriesQuery(next(numbers)))) for _ in range(40))
        details: dict[str, float | int | str] = {
            "cells": spectrum.location.n_cells,
            "samples": million.N_SAMPLES,
            "estimator": spectrum.revision.estimator,
            "goal_ms": 500,
            "series_ms": round(one * 1e3, 1),
            "series_goal_ms": 20,
            "update_s": round(update_s, 1),
            "file_mb": round(path.stat().st_size / 1e6, 1),
            "history_mb": round(history_bytes(path) / 1e6, 1),
        }
    return Figure(load * 1e3, floor * 1e3, 2.0, "ms", details)


def update(ctx: Context) -> None:
    executor = LocalExecutor(ctx, ctx.settings.update_threads)
    run_update(ctx, find_location(ctx, million.NAME).id, UpdateRequest(), executor, lambda _: None)
    executor.close()


def raw(path: Path) -> None:
    """Every row of the spectra read, checked and decompressed once."""
    decompressor = zstandard.ZstdDecompressor(dict_data=HEADERS)
    connection = sqlite3.connect(path)
    for (payload,) in connection.execute("SELECT payload FROM spectrum"):
        frame = memoryview(payload)[HEADER:]
        zlib.crc32(frame)
        decompressor.decompress(frame)
    connection.close()


def history_bytes(path: Path) -> int:
    """Of the packed segments alone."""
    connection = sqlite3.connect(path)
    ((total,),) = connection.execute("SELECT sum(length(payload)) FROM history")
    connection.close()
    return int(total)


def seconds(work: Callable[[], object]) -> float:
    started = time.perf_counter()
    work()
    return time.perf_counter() - started

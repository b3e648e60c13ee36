"""history: bytes of the demo world's database file, per stored measurement, against zstd -19 of the bare bit planes."""

import sqlite3
import tempfile
from pathlib import Path

import numpy as np
import zstandard

from tests.bench.timing import Figure
from tests.support.contexts import opened
from tests.support.server import ServerProcess
from tidemap.client import Client
from tidemap.demo.locations import FORMS
from tidemap.demo.seed import seed
from tidemap.progress import Silent
from tidemap.services.context import Context
from tidemap.services.history import read_history, window
from tidemap.services.locations import find_location

NOW = 1_772_409_600.0
TABLES = ("history", "observation", "spectrum", "anomaly")


def measure() -> Figure:
    """The file as the server leaves it, all tables, indices and free pages with it. Takes a minute or two."""
    with tempfile.TemporaryDirectory(prefix="tidemap-bench-") as folder:
        server = ServerProcess(Path(folder), env={"TIDEMAP_UPDATER": "false", "TIDEMAP_VIEWER": "false"})
        try:
            with Client(server.url) as client:
                seed(client, NOW, Silent())
        finally:
            server.stop()
        path = server.data / "tidemap.db"
        with opened(f"sqlite:///{path}") as ctx:
            locations = [find_location(ctx, name) for name in FORMS]
            measurements = sum(location.measurements for location in locations)
            floor = sum(bare(ctx, name) for name in FORMS) / measurements
        size = path.stat().st_size
        details: dict[str, float | int | str] = {"measurements": measurements, "file_kb": round(size / 1e3)}
        details |= shares(path)
        details["history_ratio"] = round(float(details["history_kb"]) * 1e3 / (floor * measurements), 2)
    return Figure(size / measurements, floor, 1.5, "B/measurement", details)


def bare(ctx: Context, name: str) -> int:
    """Bytes of the two planes of all chunks, one after the other, compressed at once."""
    location = find_location(ctx, name)
    chunks = [read_history(ctx, location, chunk, *window(ctx, location)) for chunk in range(location.n_chunks)]
    planes = [plane.ravel() for chunk in chunks for plane in (chunk.observed, chunk.occupied)]
    return len(zstandard.ZstdCompressor(level=19).compress(np.concatenate(planes).tobytes()))


def shares(path: Path) -> dict[str, int]:
    """Kilobytes of blobs by table, and of pages that are free."""
    connection = sqlite3.connect(path)
    columns = {"anomaly": "cells"}
    found = {
        f"{table}_kb": connection.execute(f"SELECT sum(length({columns.get(table, 'payload')})) FROM {table}")
        for table in TABLES
    }
    sizes = {name: round((rows.fetchone()[0] or 0) / 1e3) for name, rows in found.items()}
    (free,), (page,) = (connection.execute(f"PRAGMA {name}").fetchone() for name in ("freelist_count", "page_size"))
    connection.close()
    return sizes | {"free_kb": round(free * page / 1e3)}

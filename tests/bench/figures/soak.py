"""soak: a server under posts, questions, updates and compaction for ten minutes: its memory late against early.

Also how long it takes to stop in the midst of it all, and what is left to be compacted then.

`SOAK_S=240 python -m tests.bench soak` takes another time.
"""

import asyncio
import os
import sqlite3
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

from tests.bench import lab
from tests.bench.databases import sqlite
from tests.bench.load import Connection, request
from tests.bench.timing import Figure, quantile
from tests.support.contexts import Clock, opened
from tests.support.memory import memory_mb
from tests.support.server import ServerProcess
from tidemap.media_types import ARROW

BY_NAME = True
ROBOTS, READERS, STEP_S, LOOK_S = 16, 2, 1.0, 30.0
START = time.time() // lab.DAY_S * lab.DAY_S - 100 * lab.DAY_S
LOCATION = f"/api/v1/locations/{lab.NAME}"
ENVIRONMENT = {
    "TIDEMAP_VIEWER": "false",
    "TIDEMAP_LOG_LEVEL": "warning",
    "TIDEMAP_UPDATE_REST_S": "20",
    "TIDEMAP_HISTORY_CACHE_BYTES": str(64 * 2**20),
}
"""Half a minute of building time passes between two looks: ten to a sample, and updates are due all the time. The cache
of history is as small as to be full soon: it would grow with the history for hours, which is no leak."""
STRIDE = 257
"""Between the cells of two series, so that sixty questions ask for every chunk of the box, and fill that cache."""


@dataclass(slots=True)
class Seen:
    """What was seen on the way: seconds of every post and question; (seconds, megabytes) of memory; the WAL's size, and
    how many posts are not compacted yet."""

    posts_s: list[float] = field(default_factory=list)
    questions_s: list[float] = field(default_factory=list)
    memory: list[tuple[float, float]] = field(default_factory=list)
    wal_mb: list[float] = field(default_factory=list)
    log_posts: list[int] = field(default_factory=list)


def measure(length_s: float = float(os.environ.get("SOAK_S", "600"))) -> Figure:
    """Flat memory is a ratio near one; caches fill in the first quarter, which is left out."""
    with sqlite() as url, tempfile.TemporaryDirectory(prefix="tidemap-bench-") as folder:
        with opened(url, Clock(START)) as ctx:
            lab.prepare(ctx)
        path = Path(url.removeprefix("sqlite:///"))
        server = ServerProcess(Path(folder), database_url=url, env=ENVIRONMENT)
        try:
            seen = asyncio.run(_soak(server, path, length_s))
        finally:
            told = time.perf_counter()
            server.stop()
        stop_s = time.perf_counter() - told
        file_mb = path.stat().st_size / 1e6
        said = len(server.output().splitlines()) - 1
    early, late = (_memory(seen, length_s, *part) for part in ((0.25, 0.5), (0.75, 1.0)))
    details: dict[str, float | int | str] = {
        "seconds": round(length_s),
        "posts_per_s": round(len(seen.posts_s) / length_s, 1),
        "p50_ms": round(quantile(seen.posts_s, 0.5) * 1e3, 1),
        "p99_ms": round(quantile(seen.posts_s, 0.99) * 1e3, 1),
        "question_p99_ms": round(quantile(seen.questions_s, 0.99) * 1e3, 1),
        "slope_mb_per_min": round(_slope(seen, length_s) * 60, 2),
        "peak_mb": round(max(size for _, size in seen.memory)),
        "wal_peak_mb": round(max(seen.wal_mb), 1),
        "file_mb": round(file_mb, 1),
        "log_peak_posts": max(seen.log_posts),
        "questions_per_s": round(len(seen.questions_s) / length_s, 1),
        "stop_s": round(stop_s, 1),
        "said": said,
    }
    return Figure(late, early, 1.1, "MB", details)


async def _soak(server: ServerProcess, path: Path, length_s: float) -> Seen:
    seen, until = Seen(), time.perf_counter() + length_s
    looks = _looks()
    questions = _questions()
    work = [_repeat(server.port, lambda: next(looks), seen.posts_s, until) for _ in range(ROBOTS)]
    work += [_repeat(server.port, lambda: next(questions), seen.questions_s, until) for _ in range(READERS)]
    await asyncio.gather(*work, _watch(server, path, seen, until))
    return seen


async def _repeat(port: int, following: Callable[[], bytes], seconds: list[float], until: float) -> None:
    connection = await Connection.open(port)
    while (started := time.perf_counter()) < until:
        await connection.ask(following())
        seconds.append(time.perf_counter() - started)
    connection.close()


def _looks() -> Iterator[bytes]:
    number = 0
    while True:
        number += 1
        body = lab.seen(START + number * LOOK_S)
        yield request("POST", f"{LOCATION}/observations", body, content_type=ARROW, idempotency_key=f"{number:032x}")


def _questions() -> Iterator[bytes]:
    number = 0
    while True:
        number += 1
        cell = lab.CELLS[number * STRIDE % lab.CELLS.size]
        yield request("GET", f"{LOCATION}/state?time={START + number}", accept=ARROW)
        yield request("GET", f"/api/v1/anomalies?after={number}")
        yield request("GET", f"{LOCATION}/series?cell={cell}&step=300")


async def _watch(server: ServerProcess, path: Path, seen: Seen, until: float) -> None:
    wal = path.with_name(path.name + "-wal")
    started = time.perf_counter()
    while (now := time.perf_counter()) < until:
        seen.memory.append((now - started, memory_mb(server.process.pid)))
        seen.wal_mb.append(wal.stat().st_size / 1e6 if wal.exists() else 0.0)
        seen.log_posts.append(await asyncio.to_thread(_waiting, path))
        await asyncio.sleep(STEP_S)


def _waiting(path: Path) -> int:
    """How many posts are not compacted yet."""
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as database:
        return int(database.execute("SELECT sum(observation_seq - compacted_seq) FROM location").fetchone()[0])


def _memory(seen: Seen, length_s: float, begin: float, end: float) -> float:
    """The mean over a part of the time, in shares of it."""
    return statistics.mean(size for at, size in seen.memory if begin * length_s <= at < end * length_s)


def _slope(seen: Seen, length_s: float) -> float:
    """Megabytes a second over the last three quarters."""
    times, sizes = zip(*(pair for pair in seen.memory if pair[0] >= length_s / 4), strict=True)
    return statistics.linear_regression(times, sizes).slope

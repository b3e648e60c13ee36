"""worst_questions: how long others wait (p99, ms) while a server answers the largest question of every route.

The floor is the 100 ms that nobody should wait longer; `details` has the routes: the status and seconds of an answer,
its CPU seconds, p99 and longest wait of others in ms, and the server's memory in MB after it.
"""

import json
import tempfile
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import psutil

from tests.bench import databases
from tests.bench.figures.question import NAME, SHAPE, prepare
from tests.bench.timing import Figure
from tests.bench.waits import waiting
from tests.support.contexts import Clock, make_location, opened, post_states, refit
from tests.support.memory import memory_mb, peak_memory_mb
from tests.support.scans import files
from tests.support.server import ServerProcess
from tidemap.formats.arrow import write
from tidemap.media_types import ARROW, JSON
from tidemap.services.context import Context

DOOR, BELL, SPARE_DOOR, SPARE_HALL, WEEKS = "door", "bell", "spare-door", "spare-hall", 26
START = time.time() // 86_400 * 86_400 - WEEKS * 604_800
MAX_WAIT_MS = 100.0
LEAST_S = 3.0
ENVIRONMENT = {"TIDEMAP_UPDATER": "false", "TIDEMAP_VIEWER": "false", "TIDEMAP_LOG_LEVEL": "warning"}
LARGEST = {
    "name": "largest",
    "kind": "grid3d",
    "grid": {"resolution_m": 0.1, "shape": [400, 400, 100]},
    "interval_s": 60,
}
Question = tuple[str, str, dict[str, Any]]


def measure() -> Figure:
    with databases.sqlite() as url, tempfile.TemporaryDirectory(prefix="tidemap-bench-") as folder:
        with opened(url, Clock(START + WEEKS * 604_800)) as ctx:
            prepare(ctx, SHAPE)
            prepare_door(ctx)
            make_location(ctx, BELL)
            make_location(ctx, SPARE_DOOR)
            make_location(ctx, SPARE_HALL, SHAPE)
        server = ServerProcess(Path(folder), database_url=url, env=ENVIRONMENT)
        try:
            routes = {name: ask(server, question) for name, question in questions()}
            peak = peak_memory_mb(server.process.pid)
        finally:
            server.stop()
    worst = max(route["p99_ms"] for route in routes.values())
    return Figure(worst, MAX_WAIT_MS, 1.0, "ms p99", {"peak_mb": round(peak), "routes": json.dumps(routes)})


def prepare_door(ctx: Context) -> None:
    """Half a year of minutes of a door, with a model."""
    make_location(ctx, DOOR, estimator="calendar", time_zone="Europe/London")
    minute = np.arange(WEEKS * 7 * 1440)
    post_states(ctx, DOOR, START + 60.0 * minute, (minute % 1440 > 480) & (minute % 1440 < 1080))
    refit(ctx, DOOR)


def questions() -> Iterator[tuple[str, Question]]:
    """The largest that every route takes, and some that are too large."""
    door, hall, now = f"/locations/{DOOR}", f"/locations/{NAME}", START + WEEKS * 604_800
    whole, half = {"start": START, "stop": now}, START + WEEKS * 302_400
    million = [now + 61.0 * n for n in range(1_000_000)]
    orders = list(range(21))
    yield "nothing", ("GET", "/locations", {})
    yield "state, JSON", ("GET", f"{hall}/state?time=0", {})
    yield "state, JSON, observed", ("GET", f"{hall}/state?time=0&observed=true", {})
    yield "state, Arrow", ("GET", f"{hall}/state?time=0", {"headers": {"accept": ARROW}})
    yield "state, npy", ("GET", f"{hall}/state?time=0", {"headers": {"accept": "application/x-npy"}})
    yield "predict, 10^6 times", ("POST", f"{door}/predict", {"json": {"time": million}})
    texts = [datetime.fromtimestamp(second, UTC).isoformat() for second in million[:550_000]]
    yield "predict, 550,000 texts", ("POST", f"{door}/predict", {"json": {"time": texts}})
    yield "predict, too many", ("POST", f"{door}/predict", {"json": {"time": [*million, now]}})
    yield "predict, 10^6 cells", ("POST", f"{hall}/predict", {"json": {"time": [0.0]}})
    yield "series", ("GET", f"{door}/series?start={START}&stop={START + 999_999}&step=1", {})
    yield "information", ("GET", f"{hall}/information?start={START}&stop={START + 49 * 300}&step=300", {})
    yield "information, 10^6 cells", ("GET", f"{hall}/information?time={START}", {})
    yield "model", ("GET", f"{door}/model?order=64", {})
    yield "detect", ("POST", f"{door}/anomalies/detect", {"json": {**whole, "confidence": 0.5, "rule": "paper"}})
    yield "confidence", ("GET", f"{door}/confidence?rule=paper", {})
    yield "evaluate", ("POST", f"{door}/evaluate", {"json": {**whole, "orders": orders}})
    horizons = [60.0 * 2**n for n in range(16)]
    yield (
        "evaluate by horizon",
        ("POST", f"{door}/evaluate", {"json": {**whole, "horizons_s": horizons, "start": half}}),
    )
    yield "export, OctoMap", ("GET", f"{hall}/export?format=octomap&time={START}", {})
    yield "export, Arrow", ("GET", f"{hall}/export?format=arrow&time={START}", {})
    yield "anomalies", ("GET", "/anomalies?limit=1000", {})
    yield from posts()
    yield "locations, 16·10^6 cells", ("POST", "/locations", {"json": LARGEST})
    yield "update", ("POST", f"{door}/update?wait=60", {"json": {"estimator": "auto"}})
    yield "openapi", ("GET", "/openapi.json", {})


def posts() -> Iterator[tuple[str, Question]]:
    """The largest bodies that are accepted, in JSON, Arrow and npy, and one of each kind that is not."""
    door, hall = f"/locations/{SPARE_DOOR}/observations", f"/locations/{SPARE_HALL}/observations"
    seconds = START - 3_000_000.0 + np.arange(1_100_000.0)
    looks = [{"time": START - k, "occupied": [k], "free": [k + 1]} for k in range(100_000)]
    cells = list(range(1_000_000))
    yield "post, 10^6 times", ("POST", door, {"json": {"time": seconds.tolist(), "state": [1] * seconds.size}})
    yield "post, 10^5 looks", ("POST", hall, {"json": {"observations": looks}})
    yield "post, 10^5 looks again and one", ("POST", hall, {"json": {"observations": [*looks, looks[0]]}})
    yield "post, 10^6 cells", ("POST", hall, {"json": {"observations": [{"time": START, "occupied": cells}]}})
    yield "post, brackets", ("POST", hall, {"content": b"[" * 16_000_000, "headers": {"content-type": JSON}})
    many = {
        "time": START - 60.0 * (np.arange(8_000_000) // 1_000_000),
        "cell": (np.arange(8_000_000) % 1_000_000).astype(np.uint32),
        "state": np.ones(8_000_000, np.uint8),
    }
    arrow = {"content": bytes(write({}, many)), "headers": {"content-type": ARROW}}
    yield "post, Arrow, 8·10^6 rows", ("POST", hall, arrow)
    points = np.random.default_rng(0).uniform(-5, 5, (2_000_000, 3)).astype(np.float32)
    header = {"time": START, "map_from_sensor": [10, 10, 1, 0, 0, 0, 1], "max_range": 8}
    yield "scan, 2·10^6 points", ("POST", f"/locations/{SPARE_HALL}/scans", {"files": files(header, points)})


def ask(server: ServerProcess, question: Question) -> dict[str, float]:
    """Ask for some seconds, one question after the other, while others ask and post."""
    method, path, how = question
    process = psutil.Process(server.process.pid)
    with waiting(server.port, BELL) as waits:
        time.sleep(0.2)
        before, began, times = sum(process.cpu_times()[:2]), time.perf_counter(), 0
        while not times or time.perf_counter() - began < LEAST_S:
            answer = httpx.request(method, f"{server.url}/api/v1{path}", timeout=300, trust_env=False, **how)
            times += 1
        seconds = (time.perf_counter() - began) / times
        cpu_s = (sum(process.cpu_times()[:2]) - before) / times
    return {
        "status": answer.status_code,
        "seconds": round(seconds, 2),
        "cpu_s": round(cpu_s, 2),
        "p99_ms": round(waits.p99_ms(), 1),
        "max_ms": round(waits.max_ms(), 1),
        "mb": round(memory_mb(server.process.pid)),
    }

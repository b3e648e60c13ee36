"""sustained: a depth sweep of 70,000 points a second, registered, on a server of one core: how long others wait.

The floor is the 100 ms that nobody should wait longer (p99). `details` has the sweeps from when they are due to their
answer; of each kind of question and small post beside them p50, p99 and p99 without sweeps (`alone`), for other work on
the machine is in all of them; and the share of the core that the server used. `SUSTAINED_S=20 python -m tests.bench
sustained` takes another time.
"""

import http.client
import json
import os
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import psutil

from tests.bench import sweep
from tests.bench.databases import sqlite
from tests.bench.figures.scan import NAME, STATED, WRONG, body, prepare
from tests.bench.timing import Figure, quantile
from tests.bench.waits import waiting
from tests.support.contexts import Clock, make_location, opened
from tests.support.server import Process, ServerProcess, fresh
from tidemap.formats.scan_body import ScanBody
from tidemap.media_types import ARROW, JSON

DOOR, PERIOD_S, PAUSE_S, MAX_WAIT_MS = "door", 1.0, 0.05, 100.0
WARM_UP = 3
"""Sweeps before it counts: the first of a sample makes the surface that is expected."""
ENVIRONMENT = {"TIDEMAP_VIEWER": "false", "TIDEMAP_LOG_LEVEL": "warning"}
PATH = sweep.GRID.cell([[100, j, 30] for j in range(100, 120)]).tolist()
"""Cells ahead of it."""
AROUND = f"state?given=model&bbox={','.join(str(each) for each in (*(sweep.ORIGIN - 2.0), *(sweep.ORIGIN + 2.0)))}"
"""Two metres about the robot."""


def measure(length_s: float = float(os.environ.get("SUSTAINED_S", "60"))) -> Figure:
    with sqlite() as url, tempfile.TemporaryDirectory(prefix="tidemap-bench-") as folder:
        with opened(url, Clock(time.time())) as ctx:
            prepare(ctx)
            make_location(ctx, DOOR)
        server = ServerProcess(Path(folder), database_url=url, env=ENVIRONMENT, launch=on_one_core)
        try:
            return _measured(server, length_s)
        finally:
            server.stop()


def on_one_core(words: Sequence[str], env: Mapping[str, str], log: Path) -> Process:
    """Start a server that has the last core; what asks it has the others."""
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(cores)})
    try:
        return fresh(words, env, log)
    finally:
        os.sched_setaffinity(0, cores - {max(cores)} or cores)


def _measured(server: ServerProcess, length_s: float) -> Figure:
    for _ in range(WARM_UP):
        _sweep(server.port, 0.0)
    with _beside(server) as alone:
        time.sleep(length_s / 4)
    process, started = psutil.Process(server.process.pid), time.perf_counter()
    spent = process.cpu_times()
    with _beside(server) as kinds:
        late = [_sweep(server.port, started + PERIOD_S * number) for number in range(round(length_s / PERIOD_S))]
    whole_s, used = time.perf_counter() - started, process.cpu_times()
    details: dict[str, float | int | str] = {
        "sweeps": len(late),
        "sweep_p50_ms": _ms(late, 0.5),
        "sweep_p99_ms": _ms(late, 0.99),
        "cpu_share": round((used.user - spent.user + used.system - spent.system) / whole_s, 2),
    }
    for kind, seconds in kinds.items():
        said = (("p50", seconds, 0.5), ("p99", seconds, 0.99), ("alone_p99", alone[kind], 0.99))
        details |= {f"{kind}_{name}_ms": _ms(each, share) for name, each, share in said}
    worst = max(quantile(seconds, 0.99) for seconds in kinds.values())
    return Figure(worst * 1e3, MAX_WAIT_MS, 1.0, "ms p99", details)


def _ms(seconds: Sequence[float], share: float) -> float:
    return round(quantile(seconds, share) * 1e3, 1)


@contextmanager
def _beside(server: ServerProcess) -> Iterator[dict[str, list[float]]]:
    """Asks and posts all the while; fills what it yields with the seconds that each kind took."""
    kinds: dict[str, list[float]] = {}
    with waiting(server.port, DOOR) as others, _asking(server.port) as asked:
        yield kinds
    kinds |= others.seconds | asked


def _sweep(port: int, due: float) -> float:
    """Post a sweep when it is due; the seconds from then to its answer, so that a backlog counts."""
    sent = body(time.time(), WRONG, covariance=STATED)
    time.sleep(max(0.0, due - time.perf_counter()))
    _post(port, sent)
    return time.perf_counter() - due


def _post(port: int, sent: ScanBody) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=120)
    _ask(connection, "POST", "scans", sent.content, sent.media_type)


@contextmanager
def _asking(port: int) -> Iterator[dict[str, list[float]]]:
    """Asks what a planner asks: the cells ahead in a minute, and the surroundings of the robot by the rhythm."""
    seconds: dict[str, list[float]] = {"predict": [], "state": []}
    over = threading.Event()
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=120)

    def ask() -> None:
        while not over.wait(PAUSE_S):
            sought = json.dumps({"time": [time.time() + 60.0], "cell": PATH}).encode()
            questions = {"predict": ("POST", "predict", sought, JSON), "state": ("GET", AROUND, None, JSON)}
            for kind, question in questions.items():
                started = time.perf_counter()
                _ask(connection, *question)
                seconds[kind].append(time.perf_counter() - started)

    thread = threading.Thread(target=ask)
    thread.start()
    try:
        yield seconds
    finally:
        over.set()
        thread.join()


def _ask(
    connection: http.client.HTTPConnection, method: str, what: str, sent: bytes | bytearray | None, media_type: str
) -> None:
    header = {"Accept": f"{ARROW}, {JSON};q=.5", "Content-Type": media_type}
    connection.request(method, f"/api/v1/locations/{NAME}/{what}", sent, header)
    answer = connection.getresponse()
    said = answer.read()
    if answer.status >= 400:
        raise RuntimeError(f"{what} was answered {answer.status}: {said[:500]!r}")

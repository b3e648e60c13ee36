"""sustained: a depth sweep of 70,000 points a second, registered, on a server of one core: how long others wait.

The value is the p99 of the kind of request that waits longest, the floor the 100 ms that nobody should wait longer.
Waits are counted in processor time of the server between a request and its answer: what they would take on a core of
its own, however busy the machine is, but for the disk. `details` has them as they were, too (`wall`), those without
sweeps (`alone`), and the sweeps from when they are due to their answer. `SUSTAINED_S=20 python -m tests.bench
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
from dataclasses import dataclass, field
from pathlib import Path

from tests.bench import sweep
from tests.bench.databases import sqlite
from tests.bench.figures.scan import NAME, STATED, WRONG, body, prepare
from tests.bench.timing import Figure, quantile
from tests.support.contexts import Clock, make_location, opened
from tests.support.server import Process, ServerProcess, fresh
from tidemap.media_types import ARROW, JSON

DOOR, PERIOD_S, PAUSE_S, MAX_WAIT_MS = "door", 1.0, 0.01, 100.0
WARM_UP = 3
"""Sweeps before it counts: the first of a sample makes the surface that is expected."""
ENVIRONMENT = {"TIDEMAP_VIEWER": "false", "TIDEMAP_LOG_LEVEL": "warning"}
PATH = sweep.GRID.cell([[100, j, 30] for j in range(100, 120)]).tolist()
"""Cells ahead of the robot."""
AROUND = ",".join(str(each) for each in (*(sweep.ORIGIN - 2.0), *(sweep.ORIGIN + 2.0)))
"""Two metres about it."""
LOCATIONS = "/api/v1/locations"


@dataclass(slots=True)
class Waited:
    """Seconds until each answer of one kind, and those that the server worked meanwhile, on whatever."""

    wall_s: list[float] = field(default_factory=list)
    worked_s: list[float] = field(default_factory=list)


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
    with _asking(server) as alone:
        time.sleep(length_s / 4)
    started, before_s = time.perf_counter(), _worked_s(server)
    with _asking(server) as beside:
        late = [_sweep(server.port, started + PERIOD_S * number) for number in range(round(length_s / PERIOD_S))]
    share = (_worked_s(server) - before_s) / (time.perf_counter() - started)
    details: dict[str, float | int | str] = {
        "sweeps": len(late),
        "sweep_wall_p50_ms": _ms(late, 0.5),
        "sweep_wall_p99_ms": _ms(late, 0.99),
        "cpu_share": round(share, 2),
    }
    for kind, waited in beside.items():
        details |= {
            f"{kind}_n": len(waited.wall_s),
            f"{kind}_p50_ms": _ms(waited.worked_s, 0.5),
            f"{kind}_p99_ms": _ms(waited.worked_s, 0.99),
            f"{kind}_alone_p99_ms": _ms(alone[kind].worked_s, 0.99),
            f"{kind}_wall_p99_ms": _ms(waited.wall_s, 0.99),
        }
    return Figure(max(_ms(each.worked_s, 0.99) for each in beside.values()), MAX_WAIT_MS, 1.0, "ms p99", details)


def _ms(seconds: Sequence[float], share: float) -> float:
    return round(quantile(seconds, share) * 1e3, 1)


def _worked_s(server: ServerProcess) -> float:
    """Processor time of all threads of a server so far, to the nanosecond; those that ended are left out."""
    threads = Path(f"/proc/{server.process.pid}/task").glob("*/schedstat")
    return sum(int(each.read_text().split()[0]) for each in threads) / 1e9


def _sweep(port: int, due: float) -> float:
    """Post a sweep when it is due; the seconds from then to its answer, so that a backlog counts."""
    sent = body(time.time(), WRONG, covariance=STATED)
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=120)
    time.sleep(max(0.0, due - time.perf_counter()))
    _ask(connection, "POST", f"{LOCATIONS}/{NAME}/scans", bytes(sent.content), sent.media_type)
    return time.perf_counter() - due


@contextmanager
def _asking(server: ServerProcess) -> Iterator[dict[str, Waited]]:
    """Asks one thing after the other all the while; yields how long each kind waited."""
    kinds = {kind: Waited() for kind, *_ in _questions()}
    over = threading.Event()

    def ask() -> None:
        connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=120)
        while not over.is_set():
            for kind, method, path, sent in _questions():
                over.wait(PAUSE_S)
                worked_s, started = _worked_s(server), time.perf_counter()
                _ask(connection, method, path, sent, JSON)
                kinds[kind].wall_s.append(time.perf_counter() - started)
                kinds[kind].worked_s.append(_worked_s(server) - worked_s)

    thread = threading.Thread(target=ask)
    thread.start()
    try:
        yield kinds
    finally:
        over.set()
        thread.join()


def _questions() -> Iterator[tuple[str, str, str, bytes | None]]:
    """The kind, method, path and body: what a robot posts and a planner asks."""
    now = time.time()
    yield "healthz", "GET", "/healthz", None
    yield "post", "POST", f"{LOCATIONS}/{DOOR}/observations", json.dumps({"time": [now], "state": [1]}).encode()
    yield "predict", "POST", f"{LOCATIONS}/{NAME}/predict", json.dumps({"time": [now + 60], "cell": PATH}).encode()
    yield "state", "GET", f"{LOCATIONS}/{NAME}/state?given=model&bbox={AROUND}", None


def _ask(connection: http.client.HTTPConnection, method: str, path: str, sent: bytes | None, media_type: str) -> None:
    connection.request(method, path, sent, {"Accept": f"{ARROW}, {JSON};q=.5", "Content-Type": media_type})
    answer = connection.getresponse()
    said = answer.read()
    if answer.status >= 400:
        raise RuntimeError(f"{path} was answered {answer.status}: {said[:500]!r}")

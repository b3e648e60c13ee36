"""What a fleet does to a server: patrols, bursts after a time out of reach, dashboards, questions, open viewers.

Everything comes at its time, however busy the machine is, and every robot has a phase of its own. What the server pays
is counted in processor seconds and in bytes on the disk, so that other work beside it does not count.
"""

import asyncio
import sqlite3
import subprocess
import sys
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import closing, contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from tests.bench import lab
from tests.bench.load import Connection, cpu_clock, request
from tests.support.paths import ROOT
from tests.support.server import ServerProcess
from tidemap.media_types import ARROW, JSON

POST_S, BURST, LONE = 5.0, 4, 10
"""Seconds between two posts of a robot. Every tenth is out of reach most of the time, and posts four at once then."""
POLL_S, ASK_S = 5.0, 10.0
"""Seconds between two polls of a dashboard, and between two questions of one."""
SETTLE_S = 3.0
"""After the last request, for what the server does with it behind the answer."""
Bodies = Callable[[float], bytes]


@dataclass(frozen=True, slots=True)
class Traffic:
    """robots post, dashboards poll and ask, viewers are open, and some updates are asked for."""

    robots: int = 0
    dashboards: int = 0
    viewers: int = 0
    updates: int = 0


@dataclass(slots=True)
class Tally:
    """What was done, how many of each, and what the server paid for all of it."""

    done: Counter[str] = field(default_factory=Counter)
    seconds: float = 0.0
    cpu_s: float = 0.0
    disk: int = 0


class Load:
    """Traffic at one server on SQLite, on some laboratories. `bodies` makes what a robot sees at a time."""

    def __init__(self, server: ServerProcess, file: Path, locations: list[str], bodies: Bodies = lab.seen) -> None:
        self._server = server
        self._file = file
        self._locations = locations
        self._bodies = bodies
        self._posts = 0

    def run(self, traffic: Traffic, length_s: float) -> Tally:
        """Some seconds of it."""
        tally = Tally()
        watched = _tabs(self._server.port, self._locations[0], traffic.viewers) if traffic.viewers else nullcontext()
        with watched:
            clock, started, before = cpu_clock(self._server.process.pid), time.perf_counter(), self._bytes()
            cpu_before = time.clock_gettime(clock)
            asyncio.run(self._all(traffic, length_s, tally))
            time.sleep(SETTLE_S)
            tally.cpu_s = time.clock_gettime(clock) - cpu_before
            tally.seconds = time.perf_counter() - started
            tally.disk = self._bytes() - before
        return tally

    def _bytes(self) -> int:
        """Of all pages in use, those that are still in the log file too."""
        with closing(sqlite3.connect(f"file:{self._file}?mode=ro", uri=True)) as database:
            names = ("page_count", "freelist_count", "page_size")
            pages, free, size = (int(database.execute(f"PRAGMA {name}").fetchone()[0]) for name in names)
        return (pages - free) * size

    async def _all(self, traffic: Traffic, length_s: float, tally: Tally) -> None:
        until = time.perf_counter() + length_s
        work = [self._robot(number, until, tally) for number in range(traffic.robots)]
        work += [self._dashboard(number, until, tally) for number in range(traffic.dashboards)]
        work += [self._updates(traffic.updates, tally)]
        await asyncio.gather(*work)

    async def _robot(self, number: int, until: float, tally: Tally) -> None:
        burst = BURST if number % LONE == LONE - 1 else 1
        path = f"/api/v1/locations/{self._location(number)}/observations?source=robot-{number}"
        async for connection in self._visits(number, POST_S * burst, until):
            for back in reversed(range(burst)):
                self._posts += 1
                key = f"{time.time_ns():024x}{self._posts:08x}"
                body = self._bodies(time.time() - POST_S * back)
                await connection.ask(request("POST", path, body, content_type=ARROW, idempotency_key=key))
                tally.done["post"] += 1

    async def _dashboard(self, number: int, until: float, tally: Tally) -> None:
        name, polls = self._location(number), 0
        async for connection in self._visits(number, POLL_S, until):
            polls += 1
            await connection.ask(request("GET", "/api/v1/anomalies?limit=20"))
            await connection.ask(request("GET", f"/api/v1/locations/{name}"))
            tally.done["poll"] += 1
            if polls % round(ASK_S / POLL_S) == 0:
                await connection.ask(request("GET", f"/api/v1/locations/{name}/state", accept=ARROW))
                tally.done["question"] += 1

    async def _visits(self, number: int, period_s: float, until: float) -> AsyncIterator[Connection]:
        """Connections of somebody who comes regularly, at a phase of his own: servers hang up after five seconds."""
        due = time.perf_counter() + Random(number).uniform(0, period_s)
        while due < until:
            await asyncio.sleep(max(0.0, due - time.perf_counter()))
            connection = await Connection.open(self._server.port)
            yield connection
            connection.close()
            due += period_s

    async def _updates(self, count: int, tally: Tally) -> None:
        connection = await Connection.open(self._server.port)
        for number in range(count):
            path = f"/api/v1/locations/{self._location(number)}/update?wait=60"
            await connection.ask(request("POST", path, b'{"estimator": "fft", "order": 5}', content_type=JSON))
            tally.done["update"] += 1
        connection.close()

    def _location(self, number: int) -> str:
        return self._locations[number % len(self._locations)]


@contextmanager
def _tabs(port: int, location: str, count: int) -> Iterator[None]:
    command = [sys.executable, "-m", "tests.bench.tabs", str(port), location, str(count)]
    pipe = subprocess.PIPE
    tabs = subprocess.Popen(command, cwd=ROOT, stdin=pipe, stdout=pipe, text=True)
    try:
        assert tabs.stdout is not None
        assert tabs.stdout.readline() == "open\n"
        yield
    finally:
        tabs.kill()
        tabs.communicate()

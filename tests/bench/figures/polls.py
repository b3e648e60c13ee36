"""polls: processor time of a poll with If-None-Match beside ingest, beside that of an empty route of the same site.

Sixteen dashboards ask for the anomalies that they know already, 500 times a second in all, and are answered 304; 50
posts a second come in meanwhile, and are asked for beside the empty route too.
"""

import asyncio
import os
import subprocess
import sys
import time
from collections.abc import Callable

import psutil

from tests.bench.load import Connection, request
from tests.bench.timing import Figure
from tests.support.paths import ROOT
from tests.support.server import clean_environment

POLLS_PER_S, POSTS_PER_S, READERS = 500, 50, 16
DOOR = b'{"name":"door","interval_s":1}'


def measure(length_s: float = 8.0, rounds: int = 3) -> Figure:
    """The least of some rounds of each, in turns."""
    command = [sys.executable, "-m", "tests.bench.floor_server", "site"]
    process = subprocess.Popen(command, cwd=ROOT, env=clean_environment(), stdout=subprocess.PIPE, text=True)
    try:
        port = int(process.stdout.readline()) if process.stdout else 0
        polls, floors, rest = asyncio.run(_measure(process.pid, port, length_s, rounds))
    finally:
        process.terminate()
        process.communicate()
    details = {
        "polls_per_s": POLLS_PER_S,
        "posts_per_s": POSTS_PER_S,
        "posts_alone_cpu": round(rest, 3),
        "load_1min": round(os.getloadavg()[0], 1),
    }
    return Figure(min(polls) * 1e6, min(floors) * 1e6, 1.3, "us", details)


async def _measure(pid: int, port: int, length_s: float, rounds: int) -> tuple[list[float], list[float], float]:
    first = await Connection.open(port)
    await first.ask(request("POST", "/api/v1/locations", DOOR, content_type="application/json"))
    etag = (await first.head(request("GET", "/api/v1/anomalies?after=0")))["etag"]
    poll = request("GET", "/api/v1/anomalies?after=0", if_none_match=etag)
    empty = request("POST", "/floor")
    polls: list[float] = []
    floors: list[float] = []
    alone: list[float] = []
    for number in range(rounds):
        for content, spent in ((None, alone), (poll, polls), (empty, floors)):
            spent.append(await _cpu_s(pid, port, content, length_s, number))
    rest = min(alone)
    count = length_s * POLLS_PER_S
    return [(each - rest) / count for each in polls], [(each - rest) / count for each in floors], rest / length_s


async def _cpu_s(pid: int, port: int, content: bytes | None, length_s: float, number: int) -> float:
    """Processor seconds of the server while one thing is asked all the time beside posts; None: posts alone."""
    moments = iter(range(number * 10**6, (number + 1) * 10**6))
    process = psutil.Process(pid)
    before = sum(process.cpu_times()[:2])
    work = [_paced(port, lambda: _post(next(moments)), POSTS_PER_S, length_s)]
    if content is not None:
        work += [_paced(port, lambda: content, POLLS_PER_S / READERS, length_s) for _ in range(READERS)]
    await asyncio.gather(*work)
    return float(sum(process.cpu_times()[:2]) - before)


def _post(moment: int) -> bytes:
    body = b'{"time":[%d],"state":[0]}' % moment
    return request("POST", "/api/v1/locations/door/observations", body, content_type="application/json")


async def _paced(port: int, content: Callable[[], bytes], per_s: float, length_s: float) -> None:
    connection = await Connection.open(port)
    start = time.monotonic()
    for number in range(int(per_s * length_s)):
        await asyncio.sleep(max(0.0, start + number / per_s - time.monotonic()))
        await connection.head(content())
    connection.close()

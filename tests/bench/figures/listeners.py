"""listeners: how long an observation takes to 400 readers of events, one of each transport stuck, 200 posts a second.

The value is the p99 over all readers, from the begin of the post on; the floor is the aim, a quarter of a second.
"""

import asyncio
import os
import tempfile
import time
from pathlib import Path

import httpx
import psutil

from tests.bench.listening import listening, stuck
from tests.bench.load import Connection, request
from tests.bench.timing import Figure, quantile
from tests.support.memory import memory_mb
from tests.support.server import ServerProcess

EACH, POSTS_PER_S, ROBOTS = 199, 200, 8
AIM_S = 0.25
ENVIRONMENT = {"TIDEMAP_VIEWER": "false", "TIDEMAP_UPDATER": "false", "TIDEMAP_REQUESTS_PER_S": "0"}


def measure(length_s: float = 30.0, each: int = EACH) -> Figure:
    """Memory is taken at a third and at the end; the stuck ones have to be dropped by then."""
    with tempfile.TemporaryDirectory(prefix="tidemap-bench-") as folder:
        server = ServerProcess(Path(folder), env=ENVIRONMENT)
        try:
            return _measure(server, length_s, each)
        finally:
            server.stop()


def _measure(server: ServerProcess, length_s: float, each: int) -> Figure:
    httpx.post(f"{server.url}/api/v1/locations", json={"name": "door", "interval_s": 1}).raise_for_status()
    process = psutil.Process(server.process.pid)
    with listening(server.port, each) as heard:
        held = [stuck(server.port, transport) for transport in ("websocket", "sse")]
        began, before = time.monotonic(), sum(process.cpu_times()[:2])
        sent, early_mb = asyncio.run(_post(server, length_s))
        length = time.monotonic() - began
        time.sleep(1)
        cpu = sum(process.cpu_times()[:2]) - before
        late_mb = memory_mb(server.process.pid)
        dropped = _metric(server, "tidemap_listeners_dropped_total")
    for each_held in held:
        each_held.close()
    delays = {name: [at - sent[number] for number, at in came if number in sent] for name, came in heard.came.items()}
    all_delays = [delay for each_delays in delays.values() for delay in each_delays]
    return Figure(
        quantile(all_delays, 0.99),
        AIM_S,
        1.0,
        "s",
        {
            "readers": 2 * each,
            "posts_per_s": round(len(sent) / length_s, 1),
            "heard_share": round(len(all_delays) / max(1, len(sent) * 2 * each), 4),
            **{f"{name}_p99_ms": round(quantile(values, 0.99) * 1e3) for name, values in delays.items()},
            "median_ms": round(quantile(all_delays, 0.5) * 1e3),
            "server_cpu": round(cpu / length, 2),
            "server_us_per_message": round(cpu / max(1, len(all_delays)) * 1e6, 2),
            "early_mb": round(early_mb),
            "late_mb": round(late_mb),
            "stuck_dropped": int(dropped),
            "others_cut_off": heard.ended,
            "load_1min": round(os.getloadavg()[0], 1),
        },
    )


async def _post(server: ServerProcess, length_s: float) -> tuple[dict[int, float], float]:
    """Post one observation at a time; when each was sent, by its number, and the memory after a third."""
    connections = [await Connection.open(server.port) for _ in range(ROBOTS)]
    free: asyncio.Queue[Connection] = asyncio.Queue()
    for each in connections:
        free.put_nowait(each)
    begun: list[float] = []
    tasks: set[asyncio.Task[None]] = set()
    start, early_mb = time.monotonic(), 0.0
    for number in range(int(length_s * POSTS_PER_S)):
        await asyncio.sleep(max(0.0, start + number / POSTS_PER_S - time.monotonic()))
        connection = await free.get()
        # The numbers follow the order of the commits, which is that of these within a few milliseconds.
        begun.append(time.monotonic())
        tasks.add(asyncio.create_task(_one(connection, number, free)))
        if number == int(length_s * POSTS_PER_S / 3):
            early_mb = memory_mb(server.process.pid)
    await asyncio.gather(*tasks)
    for each in connections:
        each.close()
    return dict(enumerate(begun, 1)), early_mb


async def _one(connection: Connection, number: int, free: "asyncio.Queue[Connection]") -> None:
    body = b'{"time":[%d],"state":[1]}' % number
    await connection.ask(request("POST", "/api/v1/locations/door/observations", body, content_type="application/json"))
    free.put_nowait(connection)


def _metric(server: ServerProcess, name: str) -> float:
    lines = httpx.get(f"{server.url}/metrics").text.splitlines()
    return sum(float(line.split()[-1]) for line in lines if line.startswith(name))

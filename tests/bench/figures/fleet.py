"""fleet: what a cost model says that fifty robots, dashboards and viewers take of a server, against what they take.

The model is measured first, each kind of traffic alone, at half the rate or less. The value is its forecast of CPU
seconds, the floor what the server paid; `disk_ratio` is the same of bytes. Both are to be within 30 %.
`FLEET_S=120 python -m tests.bench fleet` takes another time.
"""

import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

from tests.bench import lab
from tests.bench.costs import measured
from tests.bench.databases import sqlite
from tests.bench.timing import Figure
from tests.bench.traffic import Load, Traffic
from tests.support.contexts import Clock, opened
from tests.support.server import ServerProcess

BY_NAME = True
NAMES = [f"lab-{number}" for number in range(5)]
FLEET = Traffic(robots=50, dashboards=10, viewers=4, updates=2)
ENVIRONMENT = {"TIDEMAP_LOG_LEVEL": "warning", "TIDEMAP_UPDATER": "false"}
"""Updates come when they are asked for, so that it is known how many there are."""


def measure(length_s: float = float(os.environ.get("FLEET_S", "60")), fleet: Traffic = FLEET) -> Figure:
    with serving() as (server, file):
        load, one = Load(server, file, NAMES), Load(server, file, NAMES[:1])
        # What is done for the first time is not what it costs.
        one.run(Traffic(robots=2, dashboards=2, viewers=1), 10.0)
        costs = measured(load, one, length_s)
        # An update compacts what waits in the log: what the measurements above left there is no part of the traffic.
        load.run(Traffic(updates=len(NAMES)), 0.0)
        seen = load.run(fleet, length_s)
    value = costs.cpu_s(seen, fleet.viewers, len(NAMES))
    details: dict[str, float | int | str] = {
        f"{name}_cost": float(f"{each:.3g}") for name, each in asdict(costs).items()
    }
    details |= dict(sorted(seen.done.items()))
    details |= {
        "seconds": round(seen.seconds),
        "robots": fleet.robots,
        "dashboards": fleet.dashboards,
        "viewers": fleet.viewers,
        "disk_kb": round(seen.disk / 1e3),
        "disk_ratio": round(costs.bytes(seen) / seen.disk, 2),
    }
    return Figure(value, seen.cpu_s, 1.3, "s CPU", details)


@contextmanager
def serving() -> Iterator[tuple[ServerProcess, Path]]:
    """A server with laboratories that have a model, and its file."""
    with sqlite() as url, tempfile.TemporaryDirectory(prefix="tidemap-bench-") as folder:
        with opened(url, Clock(time.time())) as ctx:
            for name in NAMES:
                lab.prepare(ctx, name)
        server = ServerProcess(Path(folder), database_url=url, env=ENVIRONMENT, ready_s=600)
        try:
            yield server, Path(url.removeprefix("sqlite:///"))
        finally:
            server.stop()

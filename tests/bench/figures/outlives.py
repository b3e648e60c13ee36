"""outlives: an update of 10^6 cells through the deaths of a worker, the leader and the database, against one in peace.

Both on a Dask cluster of three workers, under fifty robots; with what the test of the small form holds it to: nothing
acknowledged is lost or doubled, every event reaches a WebSocket of both servers once, `verify` is clean.
"""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any

from tests.bench.timing import Figure
from tests.support.drill import Sizes, fleet_of_processes
from tests.support.forked import Forked
from tests.support.server import ServerProcess, StartServer

BY_NAME = True
FULL = Sizes(hall=(200, 200, 25), outboxes=40, direct=10, pause_s=1.0)


def measure(sizes: Sizes = FULL) -> Figure:
    with (
        tempfile.TemporaryDirectory(prefix="tidemap-bench-") as name,
        _starting(Path(name)) as start,
        fleet_of_processes(start, Path(name), sizes) as drill,
    ):
        through_s = drill.update_through_deaths()
        peaceful_s = drill.update()
        events = len(drill.events())
    details: dict[str, float | int | str] = {
        "robots": sizes.outboxes + sizes.direct,
        "deaths": ", ".join(drill.deaths),
        "events": events,
    }
    return Figure(through_s, peaceful_s, 4.0, "s", details)


@contextmanager
def _starting(folder: Path) -> Iterator[StartServer]:
    """Starts servers in folders of their own, and stops them."""
    numbers, started = count(), list[ServerProcess]()

    def start(**how: Any) -> ServerProcess:
        own = folder / f"server-{next(numbers)}"
        own.mkdir()
        started.append(ServerProcess(own, **{"launch": Forked, **how}))
        return started[-1]

    try:
        yield start
    finally:
        for each in started:
            each.stop()

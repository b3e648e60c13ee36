"""However much is posted or asked at once, the server's memory is bounded, and everything gets in."""

import time
from concurrent.futures import ThreadPoolExecutor

import httpx
import numpy as np
import pytest

from tests.api.house import ARROW, arrow
from tests.support.memory import peak_memory_mb
from tests.support.server import StartServer, fresh
from tidemap.formats.registry import READERS

CLIENTS = 16
MEASUREMENTS = 1_200_000
BUDGET_MB = 32 * 1.048576
SLACK_MB = 60
"""Threads, connections and what the allocator keeps."""
GRID = {"frame": "map", "origin": [0, 0, 0], "resolution_m": 0.1, "shape": [200, 100, 100]}


def test_many_large_posts_at_once(server: StartServer) -> None:
    quiet = {"TIDEMAP_VIEWER": "false", "TIDEMAP_UPDATER": "false"}
    running = server(launch=fresh, env={**quiet, "TIDEMAP_MAX_PARSING_BYTES": str(32 * 2**20)})
    cells = np.arange(MEASUREMENTS, dtype=np.uint32)
    bodies = [
        arrow({"time": np.full(MEASUREMENTS, 60.0 * i), "cell": cells, "state": (cells % 2).astype(np.uint8)})
        for i in range(CLIENTS)
    ]
    with httpx.Client(base_url=f"{running.url}/api/v1", timeout=120, trust_env=False) as http:
        http.post("/locations", json={"name": "lab", "kind": "grid3d", "interval_s": 60, "grid": GRID})
        before = peak_memory_mb(running.process.pid)

        def post(number: int) -> int:
            """Send a body until it is taken; how often it was not."""
            for refused in range(1000):
                answer = http.post(
                    "/locations/lab/observations", content=bodies[number], headers={"Content-Type": ARROW}
                )
                if answer.status_code == 201:
                    return refused
                assert answer.status_code == 503, answer.text
                assert answer.json()["type"].endswith(":too-many-bodies")
                time.sleep(float(answer.headers["Retry-After"]))
            raise AssertionError("it was never taken")

        with ThreadPoolExecutor(CLIENTS) as pool:
            list(pool.map(post, range(CLIENTS)))
        taken = peak_memory_mb(running.process.pid) - before
        assert http.get("/locations/lab").json()["observations"] == CLIENTS * MEASUREMENTS
    body_mb = len(bodies[0]) / 1e6
    bound = BUDGET_MB + READERS[ARROW].cost * body_mb + SLACK_MB
    assert bound < CLIENTS * body_mb + SLACK_MB, "or the bodies alone would be within it"
    assert taken < bound


POSTS, LOOK = 60, 200_000
UNPACKED_MB = 5 * POSTS * LOOK / 1e6
"""A cell and a state of every measurement."""


@pytest.mark.parametrize(
    ("cache_mb", "bound_mb"),
    [pytest.param(8, 60, id="too-long-to-be-held"), pytest.param(256, UNPACKED_MB + 60, id="held")],
)
def test_many_questions_at_once_about_a_long_log(server: StartServer, cache_mb: int, bound_mb: float) -> None:
    """What is not compacted yet is unpacked once, and only where there is room to hold it."""
    quiet = {"TIDEMAP_VIEWER": "false", "TIDEMAP_UPDATER": "false"}
    running = server(launch=fresh, env={**quiet, "TIDEMAP_HISTORY_CACHE_BYTES": str(cache_mb * 2**20)})
    cells = np.arange(LOOK, dtype=np.uint32)
    with httpx.Client(base_url=f"{running.url}/api/v1", timeout=120, trust_env=False) as http:
        http.post("/locations", json={"name": "lab", "kind": "grid3d", "interval_s": 60, "grid": GRID})
        for i in range(POSTS):
            body = arrow({"time": np.full(LOOK, 60.0 * i), "cell": cells, "state": (cells % 2).astype(np.uint8)})
            answer = http.post("/locations/lab/observations", content=body, headers={"Content-Type": ARROW})
            assert answer.status_code == 201, answer.text
        before = peak_memory_mb(running.process.pid)

        def ask(cell: int) -> list[int]:
            observed: list[int] = http.get("/locations/lab/series", params={"cell": cell}).json()["observed"]
            return observed

        with ThreadPoolExecutor(CLIENTS) as pool:
            answers = list(pool.map(ask, range(CLIENTS)))
        taken = peak_memory_mb(running.process.pid) - before
    assert answers == [[cell % 2] * POSTS for cell in range(CLIENTS)]
    assert bound_mb < CLIENTS / 4 * UNPACKED_MB, "or each could hold it for itself"
    assert taken < bound_mb

"""However much is posted at once, the server's memory is bounded, and everything gets in."""

import time
from concurrent.futures import ThreadPoolExecutor

import httpx
import numpy as np

from app.ingest.observation import COST
from tests.api.house import ARROW, arrow
from tests.support.memory import peak_memory_mb
from tests.support.server import StartServer

CLIENTS = 16
MEASUREMENTS = 1_200_000
BUDGET_MB = 32 * 1.048576
SLACK_MB = 60
"""Threads, connections and what the allocator keeps."""
GRID = {"frame": "map", "origin": [0, 0, 0], "resolution_m": 0.1, "shape": [200, 100, 100]}


def test_many_large_posts_at_once(server: StartServer) -> None:
    quiet = {"TIDEMAP_VIEWER": "false", "TIDEMAP_UPDATER": "false"}
    running = server(env={**quiet, "TIDEMAP_MAX_PARSING_BYTES": str(32 * 2**20)})
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
    bound = BUDGET_MB + COST[ARROW] * body_mb + SLACK_MB
    assert bound < CLIENTS * body_mb + SLACK_MB, "or the bodies alone would be within it"
    assert taken < bound

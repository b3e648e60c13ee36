"""Long questions to a real server: bounded in memory, refused early, and no hindrance to its end."""

import time
from contextlib import suppress
from threading import Thread

import httpx
import numpy as np
import psutil
import pytest

from tests.support.contexts import arrow
from tests.support.memory import memory_mb, peak_memory_mb
from tests.support.server import ServerProcess, StartServer
from tests.support.waiting import until
from tidemap.history.measurements import Measurements
from tidemap.media_types import ARROW

SAMPLES = 760_000
CANCELLED_CPU_S = 8.0
"""What an evaluation may cost whose asker leaves at once; a whole one costs some 30 s."""
MORE_MB = 350
"""What a question of a million values may add to the memory of a server."""


@pytest.fixture
def door(server: StartServer) -> ServerProcess:
    """A server that knows a door, for a year and a half of minutes."""
    running = server(env={"TIDEMAP_VIEWER": "false", "TIDEMAP_UPDATER": "false"})
    with httpx.Client(base_url=f"{running.url}/api/v1", trust_env=False, timeout=120) as http:
        form = {"name": "door", "interval_s": 60, "estimator": "calendar"}
        assert http.post("/locations", json=form).status_code == 201
        minute = np.arange(SAMPLES, dtype=np.float64)
        state = ((minute % 1440 > 480) & (minute % 1440 < 1080)).astype(np.uint8)
        seen = Measurements(60.0 * minute, np.zeros(SAMPLES, np.uint32), state)
        body = bytes(arrow(seen, "state").content)
        answer = http.post("/locations/door/observations", content=body, headers={"content-type": ARROW})
        assert answer.status_code == 201, answer.text
        assert http.post("/locations/door/update?wait=60", json={}).json()["state"] == "done"
    return running


def test_a_million_times_are_answered_in_bounded_memory(door: ServerProcess) -> None:
    before = memory_mb(door.process.pid)
    url = f"{door.url}/api/v1/locations/door/predict"
    times = list(range(1_000_000))
    answer = httpx.post(url, json={"time": times}, trust_env=False, timeout=120)
    assert answer.status_code == 200
    assert len(answer.json()["probability"][0]) == len(times)
    refused = httpx.post(url, json={"time": [*times, 0]}, trust_env=False, timeout=120)
    assert refused.status_code == 422
    assert "1000001 values are more than 1000000" in refused.text
    assert peak_memory_mb(door.process.pid) - before < MORE_MB


def test_an_evaluation_ends_with_its_asker_and_with_the_server(door: ServerProcess) -> None:
    url = f"{door.url}/api/v1/locations/door/evaluate"
    longest = {"orders": list(range(65)), "start": 0, "stop": 60 * SAMPLES}
    before = cpu_s(door)
    with pytest.raises(httpx.ReadTimeout):
        httpx.post(url, json=longest, trust_env=False, timeout=0.2)
    until(lambda: idle(door))
    assert cpu_s(door) - before < CANCELLED_CPU_S
    asker = Thread(target=lambda: _ask(url, longest))
    asker.start()
    until(lambda: not idle(door))
    assert door.stop() == 0
    asker.join()
    assert "shutdown" not in door.output().lower()


def test_a_span_that_would_take_minutes_is_refused(door: ServerProcess) -> None:
    path = f"{door.url}/api/v1/locations/door"
    late = {"time": [60.0 * 3_000_000], "state": [1]}
    assert httpx.post(f"{path}/observations", json=late, trust_env=False).status_code == 201
    refused = httpx.post(f"{path}/evaluate", json={"orders": list(range(65))}, trust_env=False, timeout=60)
    assert refused.status_code == 422
    assert "evaluate a shorter time or fewer orders" in refused.text


def _ask(url: str, form: dict[str, object]) -> None:
    with suppress(httpx.TransportError):  # the server has gone
        assert httpx.post(url, json=form, trust_env=False, timeout=120).status_code in (200, 503)


def cpu_s(server: ServerProcess) -> float:
    spent = psutil.Process(server.process.pid).cpu_times()
    return float(spent.user + spent.system)


def idle(server: ServerProcess) -> bool:
    """Whether the server computes nothing for a moment."""
    before = cpu_s(server)
    time.sleep(0.3)
    return cpu_s(server) - before < 0.1

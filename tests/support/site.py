"""A running server as its clients see it: its API and its events."""

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from typing import Any

import httpx
from websockets.sync.client import connect as connect_socket
from websockets.sync.connection import Connection

from tests.support.server import ServerProcess
from tests.support.waiting import WAIT_S, until

SILENCE_S = 0.3
"""Long enough to say that nothing more comes."""
_numbers = count(1)


class Site:
    """A server with its API and its events."""

    def __init__(self, server: ServerProcess) -> None:
        self.server = server
        self.http = httpx.Client(base_url=f"{server.url}/api/v1", timeout=WAIT_S, trust_env=False)

    def __enter__(self) -> "Site":
        return self

    def __exit__(self, *_: object) -> None:
        self.http.close()

    @contextmanager
    def events(self, query: str = "", **how: Any) -> Iterator[Connection]:
        """Connected to the events."""
        address = f"ws://127.0.0.1:{self.server.port}/api/v1/events{query}"
        with connect_socket(address, proxy=None, **how) as connection:
            yield connection

    def empty_room(self, seen: int = 20) -> str:
        """A room that was never occupied; being occupied is an anomaly there, every other second anew."""
        name = f"room-{next(_numbers)}"
        form = {"name": name, "interval_s": 1, "estimator": "static", "confidence": 0.75, "event_gap_s": 0}
        assert self.http.post("/locations", json=form).status_code == 201
        self.observe(name, list(range(seen)), [0] * seen)
        assert self.update(name)["state"] == "done"
        return name

    def settled_room(self) -> str:
        """An empty room, of whose first update this server has published every message."""
        published = 'tidemap_events_total{kind="update"}'
        before = self.metric(published)
        name = self.empty_room()
        # A job is done as soon as that is stored; who listens from then on may still hear of it.
        until(lambda: self.metric(published) > before)
        return name

    def metric(self, beginning: str) -> float:
        """The sum of the metrics whose lines begin so."""
        lines = self.http.get(f"{self.server.url}/metrics").text.splitlines()
        return sum(float(line.split()[-1]) for line in lines if line.startswith(beginning))

    def observe(self, name: str, times: list[float], states: list[int]) -> Any:
        answer = self.http.post(f"/locations/{name}/observations", json={"time": times, "state": states})
        assert answer.status_code == 201, answer.text
        return answer.json()

    def update(self, name: str) -> Any:
        return self.http.post(f"/locations/{name}/update?wait=30", json={}).json()

    def anomalies(self, after: int = 0, location: str | None = None) -> list[int]:
        """The ids of all stored events after one."""
        path = "/anomalies" if location is None else f"/locations/{location}/anomalies"
        found: list[int] = []
        while True:
            page = self.http.get(path, params={"after": after, "limit": 1000}).json()
            found += [event["id"] for event in page["items"]]
            if page["next"] is None:
                return found
            after = page["next"]


def heard(connection: Connection, expected: int = 0) -> list[dict[str, Any]]:
    """As many messages as are expected, however long they take, and what comes until nothing has come for a while."""
    messages = listen_for(connection, expected)
    while True:
        try:
            messages.append(json.loads(connection.recv(timeout=SILENCE_S)))
        except TimeoutError:
            return messages


def listen_for(connection: Connection, number: int, seconds: float = WAIT_S) -> list[dict[str, Any]]:
    """The next messages."""
    deadline = time.monotonic() + seconds
    return [json.loads(connection.recv(timeout=deadline - time.monotonic())) for _ in range(number)]

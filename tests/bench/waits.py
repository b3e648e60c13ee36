"""How long others wait for a server meanwhile: a process that asks /healthz and posts one cell, again and again."""

import http.client
import json
import multiprocessing
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing.connection import Connection

from tests.bench.timing import quantile

PAUSE_S = 0.01
_processes = multiprocessing.get_context("spawn")


@dataclass(slots=True)
class Waits:
    """Seconds that each request waited, by what it was."""

    seconds: dict[str, list[float]] = field(default_factory=dict)

    def p99_ms(self) -> float:
        """Of the requests of the kind that waited longest."""
        return max(quantile(each, 0.99) for each in self.seconds.values()) * 1e3

    def max_ms(self) -> float:
        """The longest."""
        return max(max(each) for each in self.seconds.values()) * 1e3


@contextmanager
def waiting(port: int, location: str) -> Iterator[Waits]:
    """Fills what it yields at the end: what others waited meanwhile."""
    waits = Waits()
    here, there = _processes.Pipe()
    process = _processes.Process(target=_ask, args=(port, location, there))
    process.start()
    here.recv()
    try:
        yield waits
    finally:
        here.send(None)
        waits.seconds = here.recv()
        process.join()


def _ask(port: int, location: str, pipe: Connection) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=120)
    waited: dict[str, list[float]] = {"healthz": [], "post": []}
    path = f"/api/v1/locations/{location}/observations"
    pipe.send(None)
    while not pipe.poll():
        body = json.dumps({"time": [time.time()], "state": [1]})
        for kind, (method, where, content) in (("healthz", ("GET", "/healthz", None)), ("post", ("POST", path, body))):
            started = time.perf_counter()
            connection.request(method, where, content, headers={"content-type": "application/json"})
            answer = connection.getresponse()
            answer.read()
            if answer.status >= 400:
                raise RuntimeError(f"{kind} was answered {answer.status}")
            waited[kind].append(time.perf_counter() - started)
            time.sleep(PAUSE_S)
    pipe.send(waited)

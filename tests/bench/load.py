"""Requests over a few connections that are kept open, and the processor time they cost a server."""

import asyncio
import ctypes
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count

from tests.support.paths import ROOT
from tests.support.server import clean_environment


@dataclass(frozen=True, slots=True)
class Served:
    """What some requests cost: processor seconds of the server each, and the seconds until each answer."""

    cpu_s: float
    latency_s: list[float]
    wall_s: float


class Target:
    """A server by process and port."""

    def __init__(self, pid: int, port: int) -> None:
        self._clock = cpu_clock(pid)
        self._port = port

    def serve(self, requests: Sequence[bytes], connections: int) -> Served:
        """Send all requests, each connection one after the other. Raises RuntimeError on an answer that is no 2xx."""
        before, started = self._cpu_s(), time.perf_counter()
        latency = asyncio.run(_send(self._port, requests, connections))
        wall = time.perf_counter() - started
        return Served((self._cpu_s() - before) / len(requests), latency, wall)

    def _cpu_s(self) -> float:
        """All that its threads have had, to the nanosecond: the system's table of processes counts hundredths."""
        return time.clock_gettime(self._clock)


def cpu_clock(pid: int) -> int:
    """The clock of a process's processor time, for `time.clock_gettime`. Raises OSError where there is none."""
    clock = ctypes.c_int()
    error = ctypes.CDLL(None).clock_getcpuclockid(pid, ctypes.byref(clock))
    if error:
        raise OSError(error, os.strerror(error))
    return clock.value


@contextmanager
def floor_server(application: str = "bare") -> Iterator[Target]:
    """An application of `floor_server`, `bare` or `site`, in a process of its own."""
    command = [sys.executable, "-m", "tests.bench.floor_server", application]
    process = subprocess.Popen(command, cwd=ROOT, env=clean_environment(), stdout=subprocess.PIPE, text=True)
    try:
        line = process.stdout.readline() if process.stdout else ""
        target = Target(process.pid, int(line))
        yield target
    finally:
        process.terminate()
        process.communicate()


def request(method: str, path: str, body: bytes = b"", **headers: str) -> bytes:
    """The bytes of a request; underscores in the names of headers become dashes."""
    lines = [f"{method} {path} HTTP/1.1", "host: localhost", f"content-length: {len(body)}"]
    lines += [f"{name.replace('_', '-')}: {value}" for name, value in headers.items()]
    return "\r\n".join([*lines, "", ""]).encode() + body


class Connection:
    """One connection that is kept open."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer

    @classmethod
    async def open(cls, port: int) -> "Connection":
        """To a server of this machine."""
        return cls(*await asyncio.open_connection("127.0.0.1", port, limit=1 << 24))

    async def ask(self, content: bytes) -> None:
        """Send a request and read its answer. Raises RuntimeError when that is no 2xx."""
        await self.head(content, "2")

    async def head(self, content: bytes, begins: str = "") -> dict[str, str]:
        """The headers of the answer. Raises RuntimeError when its status begins otherwise, or is an error."""
        self._writer.write(content)
        head = (await self._reader.readuntil(b"\r\n\r\n")).decode("latin-1").lower()
        status, *lines = head.strip().split("\r\n")
        headers = {name.strip(): value.strip() for name, _, value in (line.partition(":") for line in lines)}
        body = await self._reader.readexactly(int(headers.get("content-length", "0")))
        if not status.startswith(f"http/1.1 {begins}") or status[9] in "45":
            raise RuntimeError(f"{head}{body[:2000]!r}")
        return headers

    def close(self) -> None:
        """Hang up."""
        self._writer.close()


async def _send(port: int, requests: Sequence[bytes], connections: int) -> list[float]:
    numbers = count()
    latency = [0.0] * len(requests)

    async def work(connection: Connection) -> None:
        while (number := next(numbers)) < len(requests):
            started = time.perf_counter()
            await connection.ask(requests[number])
            latency[number] = time.perf_counter() - started
        connection.close()

    await asyncio.gather(*[work(await Connection.open(port)) for _ in range(connections)])
    return latency

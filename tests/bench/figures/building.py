"""building: a room of 10^5 cells of a building of 10^8, a hundredth of it ever seen, over HTTP: wall time.

Of the first question about it, given what was read last, when nothing of the room is in memory: the least of ten rooms.
The floor is the half second that it may take. A server process of its own takes the posts, updates and answers;
`details` has what each of these took, and the most memory that process held.
"""

import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

import httpx
import numpy as np
import psutil
from numpy.typing import NDArray

from tests.bench import databases
from tests.bench.timing import Figure
from tests.support.memory import peak_memory_mb
from tests.support.server import ServerProcess
from tidemap.client import arrow
from tidemap.client.encoding import snapshot
from tidemap.media_types import ARROW

Value = TypeVar("Value")
BY_NAME = True
"""It takes minutes."""
NAME, SHAPE, ROOM, ROOMS, LOOKS = "building", (1000, 1000, 100), (46, 46, 47), 10, 24
"""Ten rooms of 10^5 cells each are all that was ever seen, in 24 looks an hour apart."""
RESOLUTION_M, HOUR_S, SLABS, GOAL_MS, ROUNDS = 0.05, 3600.0, 8, 500.0, 5
ENVIRONMENT = {"TIDEMAP_UPDATER": "false", "TIDEMAP_VIEWER": "false", "TIDEMAP_LOG_LEVEL": "warning"}


def measure(
    shape: tuple[int, int, int] = SHAPE,
    room: tuple[int, int, int] = ROOM,
    rooms: int = ROOMS,
    env: dict[str, str] | None = None,
) -> Figure:
    corners = list(_corners(shape, room, rooms))
    with databases.sqlite() as url, tempfile.TemporaryDirectory(prefix="tidemap-bench-") as folder:
        server = ServerProcess(Path(folder), database_url=url, env=ENVIRONMENT | (env or {}))
        try:
            with httpx.Client(base_url=f"{server.url}/api/v1", timeout=900, trust_env=False) as http:
                _create(http, shape)
                post_ms = _post(http, shape, room, corners)
                update_s, job = _timed(lambda: _update(http))
                learned_post_ms = _post(http, shape, room, corners[-1:], first=LOOKS, looks=1)
                first, first_cpu_ms, cells = _ask_all(http, server, room, corners)
                again, again_cpu_ms, _ = _ask_all(http, server, room, corners[-1:] * ROUNDS)
                refused = http.get(f"/locations/{NAME}/export?format=npz").status_code
            peak_mb = peak_memory_mb(server.process.pid)
        finally:
            server.stop()
        file_mb = Path(url.removeprefix("sqlite:///")).stat().st_size / 1e6
    details: dict[str, float | int | str] = {
        "cells": int(np.prod(shape)),
        "seen": rooms * int(np.prod(room)),
        "region": cells,
        "cpu_ms": round(first_cpu_ms, 1),
        "slowest_ms": round(max(first), 1),
        "again_ms": round(min(again), 1),
        "again_cpu_ms": round(again_cpu_ms, 1),
        "post_ms": round(post_ms, 2),
        "judged_post_ms": round(learned_post_ms, 2),
        "update_s": round(update_s, 1),
        "update": job,
        "whole": refused,
        "peak_mb": round(peak_mb),
        "file_mb": round(file_mb, 1),
    }
    return Figure(min(first), GOAL_MS, 1.0, "ms", details)


def _corners(shape: tuple[int, int, int], room: tuple[int, int, int], rooms: int) -> Iterator[tuple[int, int, int]]:
    """Where rooms begin, spread over the building."""
    room_for = [n - m for n, m in zip(shape, room, strict=True)]
    for number in range(rooms):
        at = (number + 0.5) / rooms
        yield int(room_for[0] * at), int(room_for[1] * (number * 0.618 % 1)), room_for[2] // 2


def _create(http: httpx.Client, shape: tuple[int, int, int]) -> None:
    grid = {"frame": "map", "origin": [0, 0, 0], "resolution_m": RESOLUTION_M, "shape": list(shape)}
    form = {"name": NAME, "kind": "grid3d", "interval_s": HOUR_S, "epoch": 0.0, "grid": grid, "min_cells": 4}
    http.post("/locations", json=form).raise_for_status()


def _post(
    http: httpx.Client,
    shape: tuple[int, int, int],
    room: tuple[int, int, int],
    corners: list[tuple[int, int, int]],
    first: int = 0,
    looks: int = LOOKS,
) -> float:
    """Look at every room once an hour, a slab at a time; milliseconds a post."""
    bodies = [
        arrow.write(snapshot(HOUR_S * look, cells[occupied], cells[~occupied]).named())
        for look in range(first, first + looks)
        for corner in corners
        for cells in np.array_split(_cells(shape, room, corner), SLABS)
        for occupied in [_occupied(cells, look)]
    ]
    began = time.perf_counter()
    for body in bodies:
        where = f"/locations/{NAME}/observations"
        http.post(where, content=bytes(body), headers={"content-type": ARROW}).raise_for_status()
    return (time.perf_counter() - began) / len(bodies) * 1e3


def _cells(shape: tuple[int, int, int], room: tuple[int, int, int], corner: tuple[int, int, int]) -> NDArray[np.uint32]:
    i, j, k = (np.arange(at, at + n) for at, n in zip(corner, room, strict=True))
    return ((i[:, None, None] * shape[1] + j[:, None]) * shape[2] + k).ravel().astype(np.uint32)


def _occupied(cells: NDArray[np.uint32], look: int) -> NDArray[np.bool_]:
    """A seventh always, a tenth by day."""
    return np.asarray((cells % 7 == 0) | ((cells % 10 == 1) & (8 <= look % 24 < 18)))


def _update(http: httpx.Client) -> str:
    job = http.post(f"/locations/{NAME}/update?wait=60", json={}).raise_for_status().json()
    while job["state"] in ("queued", "running"):
        time.sleep(0.05)
        job = http.get(f"/jobs/{job['id']}").raise_for_status().json()
    return str(job["state"])


def _ask_all(
    http: httpx.Client, server: ServerProcess, room: tuple[int, int, int], corners: list[tuple[int, int, int]]
) -> tuple[list[float], float, int]:
    """Milliseconds that the state of each room takes, the server's CPU for one, and the least known cells of one."""
    cpu = psutil.Process(server.process.pid).cpu_times
    before = sum(cpu()[:2])
    asked = [_ask(http, room, corner) for corner in corners]
    cpu_ms = (sum(cpu()[:2]) - before) / len(corners) * 1e3
    return [ms for ms, _ in asked], cpu_ms, min(cells for _, cells in asked)


def _ask(http: httpx.Client, room: tuple[int, int, int], corner: tuple[int, int, int]) -> tuple[float, int]:
    """Milliseconds that the state of a room takes, given what was read of it, and its known cells."""
    ends = [*corner, *(at + n for at, n in zip(corner, room, strict=True))]
    box = ",".join(f"{end * RESOLUTION_M:.6f}" for end in ends)
    where = f"/locations/{NAME}/state?bbox={box}&time={HOUR_S * (LOOKS + 5)}&observed=true"
    seconds, answer = _timed(lambda: http.get(where, headers={"accept": ARROW}).raise_for_status())
    return seconds * 1e3, len(arrow.read(answer.content)[1]["cell"])


def _timed(work: Callable[[], Value]) -> tuple[float, Value]:
    began = time.perf_counter()
    value = work()
    return time.perf_counter() - began, value

"""A server killed in the midst of a deletion has deleted all of it or nothing, and all that it acknowledged."""

import threading
import time

import httpx
import numpy as np

from tests.support.fleet import RESTLESS, dice
from tests.support.here import command
from tests.support.server import ServerProcess, StartServer
from tidemap.client import Client

KILLS = 6
MAX_KILL_S = 0.4
"""About two deletions."""
SHAPE = [64, 64]
CELLS = [0, 1500, 4095]
"""Of three chunks."""
LOOKS, PART = 48, 4
START = 1_790_000_000.0 - 1_790_000_000.0 % 60


def fill(url: str) -> None:
    """Looks at every cell, once a minute."""
    cells = np.arange(SHAPE[0] * SHAPE[1])
    with Client(url) as tidemap:
        lab = tidemap.create_location("lab", kind="grid2d", interval_s=60, grid={"resolution_m": 1, "shape": SHAPE})
        for n in range(LOOKS):
            lab.observe(np.full(len(cells), START + 60.0 * n), np.ones(len(cells)), cells)


def delete_on(url: str, part: int, done: set[int]) -> None:
    """Delete part after part of the history until the server is gone; `done` are those that it acknowledged."""
    while part < LOOKS // PART:
        start = START + 60.0 * PART * part
        try:
            asked = {"start": start, "stop": start + 60.0 * PART}
            answer = httpx.delete(f"{url}/api/v1/locations/lab/observations", params=asked, timeout=60)
        except httpx.HTTPError:
            return
        assert answer.status_code == 200, answer.text
        done.add(part)
        part += 1


def left(running: ServerProcess) -> set[int]:
    """The parts that are there, each with all of its cells and minutes."""
    with Client(running.url) as tidemap:
        lab = tidemap.location("lab")
        seen = [lab.series(cell, START, START + 60.0 * LOOKS, 60).observed >= 0 for cell in CELLS]
        count = lab.get().observations
    parts = np.stack(seen).reshape(len(CELLS), LOOKS // PART, PART)
    assert (parts.all(axis=(0, 2)) == parts.any(axis=(0, 2))).all()
    there = set(np.flatnonzero(parts.any(axis=(0, 2))).tolist())
    assert count == len(there) * PART * SHAPE[0] * SHAPE[1]
    return there


def test_a_deletion_is_done_or_not(server: StartServer, database_url: str) -> None:
    running = server(database_url=database_url, env=RESTLESS)
    fill(running.url)
    chance, done = dice(), set[int]()
    there = left(running)
    assert there == set(range(LOOKS // PART))
    for _ in range(KILLS):
        if not there:
            break
        deleting = threading.Thread(target=delete_on, args=(running.url, min(there), done))
        deleting.start()
        time.sleep(chance.uniform(0, MAX_KILL_S))
        running.kill()
        deleting.join()
        running.restart()
        before, there = there, left(running)
        assert there <= before
        assert not there & done
    verified = command("verify", "--database-url", database_url)
    assert verified.returncode == 0, verified.stdout + verified.stderr
    assert running.stop() == 0

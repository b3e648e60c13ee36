"""However a robot ends, what it kept in its outbox is stored exactly once."""

import random
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.support.fleet import EAGER, RESTLESS, dice
from tests.support.paths import ROOT
from tests.support.server import ServerProcess, StartServer, clean_environment
from tests.support.sightings import Sighting, make_locations
from tests.support.stored import check_stored
from tests.support.waiting import WAIT_S, until
from tidemap.client import Client

OUTBOXES = {0: "shared", 1: "shared", 2: "second", 3: "third"}
"""By robot: two have one together."""
DEATHS = 5
"""Of every robot."""
MAX_KILL_S = 0.5


class Life:
    """The robot's process, from its first sighting on; all its lives have one file of receipts."""

    def __init__(self, url: str, outbox: Path, receipts: Path, robot: int) -> None:
        self._receipts = receipts
        self._robot = robot
        # The one after the last may have been kept too.
        self._first = Sighting(robot, max((each.number for each in self.kept()), default=-2) + 2)
        arguments = [url, str(outbox), str(receipts), str(robot), str(self._first.number)]
        command = [sys.executable, "-m", "tests.support.robot", *arguments]
        self._process = subprocess.Popen(command, cwd=ROOT, env=clean_environment())

    def kept(self) -> list[Sighting]:
        """What `observe` returned for, in all lives; a line that was not finished does not count."""
        text = self._receipts.read_text() if self._receipts.exists() else ""
        lines = text.splitlines(keepends=True)
        return [Sighting(self._robot, int(line)) for line in lines if line.endswith("\n")]

    def kill(self, pause_s: float) -> None:
        """After its first sighting and a pause."""
        try:
            until(lambda: self._first in self.kept() or self._process.poll() is not None)
            time.sleep(pause_s)
            assert self._process.poll() is None
        finally:
            self._process.kill()
            self._process.wait()


def lead(running: ServerProcess, folder: Path, robot: int, seed: int) -> list[Sighting]:
    """All lives of a robot; what it kept."""
    chance = random.Random(seed)
    for _ in range(DEATHS):
        life = Life(running.url, folder / OUTBOXES[robot], folder / f"{robot}.receipts", robot)
        life.kill(chance.uniform(0, MAX_KILL_S))
    return life.kept()


@pytest.mark.slow
def test_robots_killed_twenty_times_lose_nothing_they_kept(server: StartServer, tmp_path: Path) -> None:
    running = server(env=RESTLESS)
    make_locations(running.url)
    chance = dice()
    with ThreadPoolExecutor(len(OUTBOXES)) as pool:
        lives = [pool.submit(lead, running, tmp_path, robot, chance.getrandbits(32)) for robot in OUTBOXES]
        for _ in range(3):
            time.sleep(chance.uniform(0, MAX_KILL_S))
            running.kill()
            running.restart()
        kept = [sighting for each in lives for sighting in each.result()]
    for name in set(OUTBOXES.values()):
        with Client(running.url, outbox=tmp_path / name, retry=EAGER) as client:
            assert client.outbox.flush(WAIT_S)
            assert client.outbox.refused() == []
    assert len(kept) >= DEATHS * len(OUTBOXES)
    # Each death may have come between the outbox and the receipt.
    check_stored(running.url, f"sqlite:///{running.data / 'tidemap.db'}", kept, unsure=DEATHS * len(OUTBOXES))

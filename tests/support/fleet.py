"""Robots at work: threads that observe and post until they are told to stop, whatever becomes of the server."""

import os
import random
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from itertools import cycle
from pathlib import Path
from typing import Any

from tests.support.sightings import Sighting
from tests.support.stored import check_stored
from tests.support.waiting import WAIT_S, until
from tidemap.client import Client, Queued, RetryPolicy, TidemapError

WITH_OUTBOX = 16
WITHOUT_OUTBOX = 2
BACKLOG = 3
"""Batches that a robot lets wait in its outbox before it observes more."""
AGAIN_S = 0.1
PAUSE_S = 0.02
"""Between two posts of one without an outbox: a kill finds posts under way, and the machine does other work too."""
EAGER = RetryPolicy(first_s=0.05, max_s=0.2)
ONCE = RetryPolicy(tries=1)
RESTLESS = {
    "TIDEMAP_VIEWER": "false",
    "TIDEMAP_UPDATER_INTERVAL_S": "0.2",
    "TIDEMAP_UPDATE_REST_S": "0",
    "TIDEMAP_UPDATE_GROWTH": "0.01",
}
"""A server that refits and compacts all the time, so that its end comes in the midst of that too."""


class OutboxRobot:
    """Keeps what it sees in an outbox; every fifth observation twice, with the same key."""

    def __init__(self, number: int, client: Client[Queued], pause_s: float) -> None:
        self.number = number
        self.client = client
        self.pause_s = pause_s
        self.kept: list[Sighting] = []

    def run(self, stop: threading.Event) -> None:
        """Fill the outbox, and again after every pause."""
        while not stop.wait(self.pause_s):
            while self.client.outbox.pending.batches < BACKLOG and not stop.is_set():
                self._observe(Sighting(self.number, len(self.kept)))

    def _observe(self, sighting: Sighting) -> None:
        key = f"{sighting}" if sighting.number % 5 == 0 else None
        for _ in range(1 if key is None else 2):
            sighting.post(self.client, key)
        self.kept.append(sighting)


class DirectRobot:
    """Posts without an outbox, each observation as often as it takes to hear that it is stored, with the same key."""

    def __init__(self, number: int, client: Client[Any], pause_s: float) -> None:
        self.number = number
        self.client = client
        self.pause_s = pause_s
        self.kept: list[Sighting] = []
        self.failures: list[int] = []
        """HTTP status of every try that failed, 0 where nobody answered."""

    def run(self, stop: threading.Event) -> None:
        """Post one after the other; of the last it may not have heard."""
        while not stop.wait(self.pause_s):
            sighting = Sighting(self.number, len(self.kept))
            try:
                sighting.post(self.client, f"{sighting}")
            except TidemapError as error:
                self.failures.append(error.status)
                stop.wait(AGAIN_S)
            else:
                self.kept.append(sighting)


class Fleet:
    """Robots with an outbox and robots without."""

    def __init__(self, outboxes: list[OutboxRobot], direct: list[DirectRobot]) -> None:
        self.outboxes = outboxes
        self.direct = direct

    @property
    def robots(self) -> list[OutboxRobot | DirectRobot]:
        """All of them."""
        return [*self.outboxes, *self.direct]

    @property
    def kept(self) -> list[Sighting]:
        """All that a robot may rely on."""
        return [sighting for robot in self.robots for sighting in robot.kept]

    @property
    def failures(self) -> list[int]:
        """The status of every direct post that failed."""
        return [status for robot in self.direct for status in robot.failures]

    def acknowledged(self) -> int:
        """How many direct posts the server has answered."""
        return sum(len(robot.kept) for robot in self.direct)

    def wait_for_answers(self, count: int) -> None:
        """Until the server has answered so many more direct posts."""
        before = self.acknowledged()
        until(lambda: self.acknowledged() >= before + count)

    def deliver(self) -> None:
        """Wait until every outbox is empty; none of it was refused."""
        for robot in self.outboxes:
            assert robot.client.outbox.flush(WAIT_S), robot.client.outbox.pending
            assert robot.client.outbox.refused() == []

    def check(self, url: str, database_url: str) -> None:
        """Everything that a robot may rely on is stored exactly once, and nothing else but what was under way."""
        check_stored(url, database_url, self.kept, unsure=len(self.direct))


@contextmanager
def fleet_at_work(
    folder: Path, *urls: str, outboxes: int = WITH_OUTBOX, direct: int = WITHOUT_OUTBOX, pause_s: float = PAUSE_S
) -> Iterator[Fleet]:
    """Robots at work until the end of the block, each on one of the servers; then all that they kept is delivered.

    pause_s: how long each rests between posts, or between those that its outbox holds; by default hardly.
    """
    with ExitStack() as stack:
        stop = threading.Event()
        fleet = Fleet(
            [
                OutboxRobot(
                    n, stack.enter_context(Client(url, outbox=folder / f"{n}.db", retry=EAGER)), max(pause_s, AGAIN_S)
                )
                for n, url in zip(range(outboxes), cycle(urls), strict=False)
            ],
            [
                DirectRobot(outboxes + n, stack.enter_context(Client(url, retry=ONCE)), pause_s)
                for n, url in zip(range(direct), cycle(urls), strict=False)
            ],
        )
        pool = stack.enter_context(ThreadPoolExecutor(outboxes + direct))
        running = [pool.submit(robot.run, stop) for robot in fleet.robots]
        try:
            yield fleet
        finally:
            stop.set()
            for each in running:
                each.result()
        fleet.deliver()


def dice() -> random.Random:
    """Chance for a test: the same in every run of CI, new elsewhere, and shown when the test fails."""
    seed = 0 if "CI" in os.environ else random.randrange(1 << 32)
    print(f"seed {seed}")
    return random.Random(seed)

"""The robot that lives on: it posts what it sees now, for as long as it is let."""

import logging
import time
from collections.abc import Callable
from threading import Event
from typing import Protocol

from tidemap.client import Client, TidemapError
from tidemap.demo.civil import DAY_S
from tidemap.demo.locations import BUILDING, prepare
from tidemap.demo.posting import Posting
from tidemap.demo.robot import INTERVAL_S, Robot
from tidemap.demo.seed import ROUNDS_AT_ONCE, SEED, chunks, rounds
from tidemap.demo.story import PLANT_STAYS_S, Story
from tidemap.demo.world import World

log = logging.getLogger(__name__)
CATCH_UP_S = DAY_S
PAUSE_S = 5.0
TOO_MANY_REQUESTS = 429


class Patrol(Protocol):
    """A robot on its way through what the server knows."""

    def go(self, now: float, every_s: float) -> None:
        """Post what was missed, of a day at most, and the latest of every `every_s` seconds."""


def run(
    client: Client,
    stop: Event,
    speed: float = 1.0,
    clock: Callable[[], float] = time.time,
    begin: Callable[[Client, float], Patrol] | None = None,
) -> None:
    """Post a round every five minutes / `speed`, at the time of `clock`, until `stop` is set.

    `begin` starts the patrol at a time, by default `Rounds`. First it catches up on what was missed, of a day at most.
    While the server fails or is out of reach it goes on trying. Raises TidemapError when the server refuses what it is
    asked, NotTheDemoError.
    """
    begin = begin or Rounds
    patrol: Patrol | None = None
    while not stop.is_set():
        try:
            patrol = patrol or begin(client, clock())
            patrol.go(clock(), INTERVAL_S / speed)
            pause_s = seconds_to_next(clock(), INTERVAL_S / speed)
        except TidemapError as error:
            if 400 <= error.status < 500 and error.status != TOO_MANY_REQUESTS:
                raise
            log.warning("the demo's robot tries again in %.0f s: %s", PAUSE_S, error)
            pause_s = PAUSE_S
        stop.wait(pause_s)


class Rounds:
    """The rounds of the robot in a building the server knows."""

    def __init__(self, client: Client, now: float) -> None:
        known = prepare(client)
        first = known[BUILDING].first_time
        self._robot = Robot(World(SEED, Story(plant_moves=(now if first is None else first) + PLANT_STAYS_S)))
        self._posting = Posting(client, known)

    def go(self, now: float, every_s: float) -> None:
        """Post the rounds of every five minutes that were missed, and the latest of every `every_s` seconds."""
        for some in chunks(due(self._posting.since(), now, every_s), ROUNDS_AT_ONCE):
            self._posting.post(self._robot.observations(some))


def due(since: float, now: float, every_s: float) -> list[float]:
    """The times of rounds after `since`, of a day at most, and the latest multiple of `every_s` seconds.

    >>> due(300.0, 950.0, 30.0)
    [600.0, 900.0, 930.0]
    """
    missed = rounds(max(since, now - CATCH_UP_S), now)
    return sorted({*missed.tolist(), now - now % every_s})


def seconds_to_next(now: float, every_s: float) -> float:
    """Seconds until the next multiple of `every_s`.

    >>> seconds_to_next(310.0, 300.0)
    290.0
    """
    return every_s - now % every_s

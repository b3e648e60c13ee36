"""What the robots of the crash tests see: made from a robot's number and a count, so that everybody can make it again.

Every time says which post it belongs to, and no two posts share a time; but all robots measure the same cells in the
same samples, in no order, so that most measurements are late and have to make way for others, or not.
"""

import random
from dataclasses import dataclass
from functools import partial

from tests.support.truth import Row
from tidemap.client import Client, Queued
from tidemap.history.timebase import TimeBase
from tidemap.schemas.observations import Accepted

BASE = TimeBase(0.0, 64.0)
SAMPLES = range(4000, 4200)
"""They lie in two segments."""
POSTS = 1 << 12
"""More than any robot makes."""
SHAPE = (17, 16, 16)
LOCATIONS = {"door": (0,), "lab": (0, 1023, 1024, 3000, 4351)}
"""The cells that are looked at. Those of the lab lie in four of its five chunks."""
_STEP_S = BASE.interval_s / (1 << 18)


@dataclass(frozen=True, slots=True, order=True)
class Sighting:
    """One post of a robot."""

    robot: int
    number: int

    @property
    def location(self) -> str:
        """The location."""
        return list(LOCATIONS)[self.number % 2]

    @property
    def source(self) -> str:
        """The robot's name."""
        return f"robot-{self.robot}"

    @property
    def rows(self) -> list[Row]:
        """Some cells in some samples."""
        chance = random.Random(self.robot * POSTS + self.number)
        pairs = [(sample, cell) for sample in chance.sample(SAMPLES, 3) for cell in LOCATIONS[self.location]]
        offset_s = _STEP_S * (self.number * (1 << 6) + self.robot)
        return [(float(BASE.time(sample)) + offset_s, cell, chance.randrange(2)) for sample, cell in pairs]

    @classmethod
    def at(cls, time_s: float) -> "Sighting":
        """The one that has this time."""
        number, robot = divmod(int(time_s % BASE.interval_s / _STEP_S), 1 << 6)
        return cls(robot, number)

    def post(self, client: Client[Accepted] | Client[Queued], key: str | None = None) -> None:
        """Observe it."""
        time, cell, state = zip(*self.rows, strict=True)
        cells = None if self.location == "door" else cell
        client.location(self.location).observe(time, state, cells, source=self.source, idempotency_key=key)


def make_locations(url: str) -> None:
    """Make the locations on the server at `url`."""
    with Client(url) as tidemap:
        create = partial(
            tidemap.create_location, interval_s=BASE.interval_s, epoch=BASE.epoch, estimator="fft", order=2
        )
        create("door")
        create("lab", kind="grid3d", grid={"resolution_m": 0.5, "shape": list(SHAPE)})

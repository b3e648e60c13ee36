"""What the robot sees of the building on its rounds."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tidemap.demo import plan
from tidemap.demo.chance import draw, draws
from tidemap.demo.plan import Cells
from tidemap.demo.world import World

INTERVAL_S = 300.0
MISSED = 0.08
FLICKER = 0.04
FLICKERING_CELLS = 0.12
FREE_SPACE = 0.08
SHADOW = (11, 8)
"""Cells along x and y that something hides on every round, from floor to ceiling."""

_VISIT, _SHADOW_X, _SHADOW_Y, _NOISE, _FLICKERS, _FREE = range(100, 106)


@dataclass(frozen=True, slots=True, eq=False)
class RobotObservation:
    """What was seen at `time` (Unix seconds): cell (n,) uint32 in C order, state (n,) uint8; named locations."""

    time: float
    cell: NDArray[np.uint32]
    state: NDArray[np.uint8]
    locations: dict[str, bool]


class Robot:
    """Goes round the building every five minutes and sees what moves, and some of what stands, from near by.

    Each round it looks closely at one of the rooms. It sees surfaces and the free space around what moves,
    but neither the inside of walls nor most of the air. Its sensor errs now and then beside what moves, and
    never on what stands.
    """

    def __init__(self, world: World) -> None:
        self.world = world
        moving = plan.moving()
        self._always = moving | _near(moving) & ~world.standing
        self._closely = self._surfaces(world.standing)
        self._flickers = self._flickering(moving)

    def observe(self, time: float) -> RobotObservation | None:
        """What the robot sees at Unix seconds; None when it is elsewhere. About 0.3 ms."""
        visit = int(time)
        if not self.world.story.happening(time) and draw(self.world.seed, _VISIT, visit) < MISSED:
            return None
        occupied = self.world.occupancy(time).ravel()
        occupied[self._errors(visit)] ^= True
        seen = self._seen(visit)
        cell = np.flatnonzero(seen).astype(np.uint32)
        return RobotObservation(time, cell, occupied[cell].astype(np.uint8), self.world.states(time))

    def observations(self, times: Iterable[float]) -> list[RobotObservation]:
        """What the robot sees on the rounds that it makes of those at `times`."""
        return [observation for observation in map(self.observe, times) if observation is not None]

    def _seen(self, visit: int) -> Cells:
        seen = self._always.copy()
        room = plan.ROOMS[int(visit // INTERVAL_S) % len(plan.ROOMS)]
        seen[room] |= self._closely[room]
        seen[self._shadow(visit)] = False
        return seen

    def _shadow(self, visit: int) -> tuple[slice, slice]:
        x = int(draw(self.world.seed, _SHADOW_X, visit) * plan.SHAPE[0])
        y = int(draw(self.world.seed, _SHADOW_Y, visit) * plan.SHAPE[1])
        return slice(x, x + SHADOW[0]), slice(y, y + SHADOW[1])

    def _surfaces(self, standing: Cells) -> Cells:
        """Surfaces of what stands, and a part of the free space, seen from near by."""
        number = np.arange(standing.size, dtype=np.uint64)
        sampled = (draws(number, self.world.seed, _FREE) < FREE_SPACE).reshape(plan.SHAPE)
        return standing & _near(~standing) | ~standing & sampled

    def _flickering(self, moving: Cells) -> NDArray[np.uint64]:
        """The few cells beside what moves on which the sensor errs, no two of them neighbours."""
        beside = np.flatnonzero(_near(moving) & ~moving & ~self.world.standing & _checkered()).astype(np.uint64)
        return beside[draws(beside, self.world.seed, _FLICKERS) < FLICKERING_CELLS]

    def _errors(self, visit: int) -> NDArray[np.uint64]:
        return self._flickers[draws(self._flickers, self.world.seed, _NOISE, visit) < FLICKER]


def _near(cells: Cells) -> Cells:
    """Cells with a face in common with one of `cells`."""
    near = np.zeros_like(cells)
    for axis in range(3):
        low = tuple(slice(None, -1) if i == axis else slice(None) for i in range(3))
        high = tuple(slice(1, None) if i == axis else slice(None) for i in range(3))
        near[low] |= cells[high]
        near[high] |= cells[low]
    return near


def _checkered() -> Cells:
    """Every second cell; no two have a face in common."""
    return np.asarray(np.indices(plan.SHAPE).sum(axis=0) % 2 == 0)

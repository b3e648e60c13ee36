"""The robot's visits to the areas: what its sensors measure and where it believes itself to be."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tidemap.demo.areas import CAMERA_M, LASER_M, Area
from tidemap.demo.chance import draw, mix
from tidemap.demo.civil import moment
from tidemap.demo.sensors import CAMERA, LASER, RangeSensor, Walker
from tidemap.demo.world import World
from tidemap.space.pose import Array, Pose

MISSED = 0.03
"""Of all visits: the robot is elsewhere."""
SIGMA = np.repeat([0.04, np.radians(2.0)], 3)
"""Standard deviations (6,) of a stated pose: x, y, z in metres, and the rotations about them in radians."""
SURVEY_SIGMA = np.repeat([0.005, np.radians(0.2)], 3)
"""While somebody who measures it is with the robot."""
PLANE = np.array([1.0, 1.0, 0.0, 0.0, 0.0, 1.0])
"""What is wrong with the pose of a planar laser: it stands level."""
STAND_SIGMA_M, STAND_SIGMA_RAD = 0.05, np.radians(10.0)
"""How far from its stand, and from facing along x, the robot stops."""
UNSEEN_PERSON, IMAGINED_PERSON = 0.03, 0.005
"""How often the detector of people errs."""

_MISSED, _WALKS, _MISSES, _IMAGINES, _STANDS, _CAMERA, _LASER = range(200, 207)


@dataclass(frozen=True, slots=True, eq=False)
class Scanned:
    """points (n, 3) float32 about the sensor; where the robot says it was, its covariance (6, 6), and where it was."""

    sensor: RangeSensor
    points: NDArray[np.float32]
    stated: Pose
    covariance: Array
    true: Pose


@dataclass(frozen=True, slots=True, eq=False)
class Visit:
    """A visit at `time` (Unix seconds): sweeps of the depth camera and of the laser, and whether a person was seen."""

    area: Area
    time: float
    camera: Scanned
    laser: Scanned
    person: bool


class Visitor:
    """The robot on its visits; a function of the world's seed, the area and the time, in any order.

    Until `surveyed_until` (Unix seconds) its poses are good: somebody measures them, so that there is a first map.
    """

    def __init__(self, world: World, surveyed_until: float = 0.0) -> None:
        self.world = world
        self.surveyed_until = surveyed_until

    def visit(self, area: Area, time: float) -> Visit | None:
        """What is measured in an area; None when the robot is elsewhere. About 5 ms."""
        key = (self.world.seed, area.number, int(time))
        person = self.person(area, time)
        if person is None:
            return None
        walks = self._walks(area, time)
        camera, laser = self._stand(area, CAMERA_M, *key), self._stand(area, LASER_M, *key)
        return Visit(
            area,
            time,
            self._scan(CAMERA, area, time, camera, walks, _CAMERA),
            self._scan(LASER, area, time, laser, walks, _LASER),
            person,
        )

    def person(self, area: Area, time: float) -> bool | None:
        """Whether a person is seen in an area; None when the robot is elsewhere. Without the scans of a visit."""
        if draw(self.world.seed, area.number, int(time), _MISSED) < MISSED:
            return None
        return self._sees_person(area, time, self._walks(area, time))

    def _walks(self, area: Area, time: float) -> bool:
        return draw(self.world.seed, area.number, int(time), _WALKS) < area.passes(moment(time))

    def _sees_person(self, area: Area, time: float, walks: bool) -> bool:
        key = (self.world.seed, area.number, int(time))
        if walks or not self.world.taken(time).isdisjoint(area.seats):
            return draw(*key, _MISSES) >= UNSEEN_PERSON
        return draw(*key, _IMAGINES) < IMAGINED_PERSON

    def _stand(self, area: Area, height_m: float, *key: int) -> Pose:
        """Where a sensor is: the same for all on one visit."""
        off = np.random.default_rng(mix(*key, _STANDS)).normal(size=3)
        x, y = np.array(area.stand) + STAND_SIGMA_M * off[:2]
        return Pose.of_rotation_vector([0.0, 0.0, STAND_SIGMA_RAD * off[2]], [x, y, height_m])

    def _scan(self, sensor: RangeSensor, area: Area, time: float, true: Pose, walks: bool, number: int) -> Scanned:
        chance = np.random.default_rng(mix(self.world.seed, area.number, int(time), number))
        walkers = [_walker(area, len(sensor.frames), chance)] if walks else []
        sigma = SURVEY_SIGMA if time < self.surveyed_until else SIGMA
        error = chance.normal(size=6) * sigma * (PLANE if sensor.flat else 1.0)
        points = sensor.sweep(self.world.occupancy(time), true, walkers, chance)
        stated = Pose(
            Pose.of_rotation_vector(error[3:], np.zeros(3)).rotation @ true.rotation, true.translation + error[:3]
        )
        return Scanned(sensor, points, stated, np.diag(sigma**2), true)


def _walker(area: Area, n_frames: int, chance: np.random.Generator) -> Walker:
    """Somebody who comes along the area's path at some time of a sweep, either way."""
    start, stop = (np.array(end) for end in area.path[:: chance.choice([-1, 1])])
    share = chance.uniform(-0.5, 0.5) + np.linspace(0, 1, n_frames)
    share = np.where((share >= 0) & (share <= 1), share, np.nan)
    return Walker(start + share[:, np.newaxis] * (stop - start))

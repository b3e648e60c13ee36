"""The robot's sensors: a depth camera on a pan-tilt unit, and a planar laser that is swept by the robot's rotation.

A sweep is a number of frames from one position, as one cloud about the sensor. Ranges have noise, some rays drop out,
some frames are lost, and between frames people walk.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tidemap.demo import plan
from tidemap.demo.plan import Cells
from tidemap.space.first_ranges import first_ranges
from tidemap.space.grid import GridGeometry
from tidemap.space.pose import Array, Pose
from tidemap.space.ranges import BEYOND

BUILDING = GridGeometry("map", (0.0, 0.0, 0.0), plan.RESOLUTION_M, plan.SHAPE)
PERSON_RADIUS_M, PERSON_HEIGHT_M = 0.2, 1.75
LOST_FRAMES = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class Walker:
    """Somebody who walks through, upright: where (n_frames, 2) at each frame of a sweep, NaN while out of sight."""

    path: Array


@dataclass(frozen=True, slots=True, eq=False)
class RangeSensor:
    """rays (n, 3): unit directions of one frame, x forward, y left; frames (m, 2): pan and tilt of each, rad, up > 0.

    The standard deviation of a range r is `noise_m` + `noise_per_m` · r²; `dropout` is the share of rays that are lost.
    """

    rays: Array
    frames: Array
    min_range_m: float
    max_range_m: float
    noise_m: float
    noise_per_m: float
    dropout: float
    flat: bool

    def sweep(
        self, occupancy: Cells, map_from_sensor: Pose, walkers: Sequence[Walker], chance: np.random.Generator
    ) -> NDArray[np.float32]:
        """Points (k, 3) about the sensor, k at most n · m; those that met nothing are beyond the longest range."""
        kept = chance.random(len(self.frames)) >= LOST_FRAMES
        kept[0] |= not kept.any()
        ways = np.concatenate([self._ways(frame) for frame in self.frames[kept]])
        along = ways @ map_from_sensor.rotation.T
        exact = first_ranges(BUILDING, occupancy, map_from_sensor.translation, along, self.max_range_m)
        for walker in walkers:
            at = np.repeat(walker.path[kept], len(self.rays), axis=0)
            exact = np.minimum(exact, _range_of_person(at, map_from_sensor.translation, along))
        return self._measured(ways, exact, chance)

    def _ways(self, frame: Array) -> Array:
        """The rays of a frame about the sensor."""
        pan, tilt = frame
        return self.rays @ (_about(2, pan) @ _about(1, -tilt)).T

    def _measured(self, ways: Array, exact: Array, chance: np.random.Generator) -> NDArray[np.float32]:
        deviation = chance.normal(size=len(exact))
        dropped = chance.random(len(exact)) < self.dropout
        with np.errstate(invalid="ignore"):
            measured = exact + deviation * (self.noise_m + self.noise_per_m * exact**2)
        measured[~(measured <= self.max_range_m)] = BEYOND * self.max_range_m
        kept = ~dropped & (measured >= self.min_range_m)
        return (ways[kept] * measured[kept, np.newaxis]).astype(np.float32)


def _about(axis: int, angle: float) -> Array:
    """The rotation (3, 3) about one of the axes."""
    vector = np.zeros(3)
    vector[axis] = angle
    return Pose.of_rotation_vector(vector, np.zeros(3)).rotation


def _range_of_person(at: Array, start: Array, along: Array) -> Array:
    """Metres (n,) along unit directions (n, 3) to somebody at (n, 2), a cylinder; infinite where a ray passes."""
    away = start[:2] - at
    square = along[:, 0] ** 2 + along[:, 1] ** 2
    half = np.einsum("ij,ij->i", away, along[:, :2])
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(half**2 - square * (np.einsum("ij,ij->i", away, away) - PERSON_RADIUS_M**2))
        distance = (-half - root) / square
        height = start[2] + distance * along[:, 2]
        hit = (distance > 0) & (height >= 0) & (height <= PERSON_HEIGHT_M)
    return np.where(hit, distance, np.inf)


def _camera_rays(columns: int, rows: int, width: float, height: float) -> Array:
    """Directions (n, 3) of the pixels of a pinhole camera with fields of view in radians."""
    across = np.tan(width / 2) * ((np.arange(columns) + 0.5) / columns * 2 - 1)
    up = np.tan(height / 2) * ((np.arange(rows) + 0.5) / rows * 2 - 1)
    y, z = (each.ravel() for each in np.meshgrid(across, up))
    rays = np.stack([np.ones_like(y), y, z], axis=1)
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def _laser_rays(n: int, width: float) -> Array:
    """Directions (n, 3) in the plane."""
    angle = ((np.arange(n) + 0.5) / n - 0.5) * width
    return np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)


def _frames(pans: int, tilts: Sequence[float]) -> Array:
    """(m, 2) all around, once for each tilt in degrees."""
    around = np.arange(pans) / pans * 2 * np.pi
    return np.array([(pan, np.radians(tilt)) for tilt in tilts for pan in around])


CAMERA = RangeSensor(
    rays=_camera_rays(40, 30, np.radians(57), np.radians(43)),
    frames=_frames(7, (-22.0, 14.0)),
    min_range_m=0.4,
    max_range_m=4.5,
    noise_m=0.003,
    noise_per_m=0.0015,
    dropout=0.04,
    flat=False,
)
"""14 frames of 1,200 rays: some 16,000 points a sweep, 1.4 degrees apart. Its noise is that of structured light."""
LASER = RangeSensor(
    rays=_laser_rays(360, np.radians(270)),
    frames=_frames(2, (0.0,)),
    min_range_m=0.1,
    max_range_m=8.0,
    noise_m=0.01,
    noise_per_m=0.0,
    dropout=0.01,
    flat=True,
)
"""Two frames of 360 rays, forward and back."""

"""Registration: a scan's pose put right by the map, or a reason why it is not.

An alignment that converged may be wrong, and one that is wrong spoils the map. So it is accepted only where it came to
rest, is held in every direction, agrees with what was said of the pose, and is found again from two other starts
(docs/sensors.md has the figures). Otherwise the stated pose stands if it is good enough by itself; else no cell is
written.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import chdtrc, chdtri

from tidemap.space.alignment import MAX_POINTS, MAX_ROUGH_POINTS, Alignment, Surface
from tidemap.space.pose import Array, Pose
from tidemap.space.scan import Scan

RegistrationMode = Literal["auto", "always", "never"]
"""Whether to register: where a covariance says how wrong the pose may be, in any case, or not at all."""
Verdict = Literal["accepted", "raw_pose", "quarantined"]
MIN_POINTS, MIN_INLIERS = 50, 20
"""Cells of the map, or points of a scan, and those of its thinned points that meet the map: with fewer there is nothing
to hold on to."""
MIN_WEAKEST, MIN_WEAKEST_FLAT = 0.02, 0.05
"""The least `Alignment.weakest` that holds a scan, in space and in the plane, where fewer directions share it."""
MAX_SIGMAS = 3.0
"""How unlikely a correction may be, as so many standard deviations of one number."""
MAX_DISAGREEMENT_CELLS, MAX_DISAGREEMENT_RAD = 0.5, np.radians(0.5)
"""How far apart the alignments from several starts may end."""
ASSUMED_SIGMA_M, ASSUMED_SIGMA_RAD = 0.1, np.radians(3.0)
"""What is assumed of a pose that comes without a covariance and is to be registered all the same."""
OWN_SIGMA_RAD = np.radians(0.5)
"""What cells leave open of a rotation; of a translation it is half a cell."""
STARTS = np.stack([np.ones(6), -np.ones(6)])
"""From where to align again: one standard deviation to either side of the stated pose, in all directions."""
PLANE = [0, 1, 5]
"""Of x, y, z and the rotations about them those of the plane."""


@dataclass(frozen=True, slots=True)
class Features:
    """What a verdict rests on.

    weakest, inliers: as of `Alignment`; weakest is the least of all starts. sigmas: how unlikely the correction is, as
    so many standard deviations of one number. disagreement_m, disagreement_rad: how far from the first others ended.
    """

    converged: bool
    weakest: float
    inliers: int
    sigmas: float
    disagreement_m: float
    disagreement_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class RegistrationOutcome:
    """A verdict and why; the pose that stands, or stood before a quarantine; what an alignment came to, if there was
    one: the correction (6,) of the stated pose (x, y, z in m, rotation vector in rad, in the map's axes)."""

    verdict: Verdict
    reason: str
    map_from_sensor: Pose
    correction: Array | None = None
    features: Features | None = None


def as_stated(scan: Scan, reason: str) -> RegistrationOutcome:
    """The stated pose, without a look at the map."""
    return RegistrationOutcome("raw_pose", reason, scan.map_from_sensor)


def register(scan: Scan, surface: Surface) -> RegistrationOutcome:
    """Put a scan's pose right by what is expected to be there."""
    if surface.n_points < MIN_POINTS:
        return _fallback(scan, surface, "the map has too few occupied cells around the sensor")
    points = scan.returns
    if len(points) < MIN_POINTS:
        return _fallback(scan, surface, "the scan has too few points")
    covariance = _covariance(scan)
    source, rough = (surface.source(points, scan.map_from_sensor, most) for most in (MAX_POINTS, MAX_ROUGH_POINTS))
    reach = np.sqrt(np.diag(covariance)) * (_plane_mask() if surface.flat else 1.0)
    found = [surface.align(source, np.zeros(6)), *(surface.align(rough, start * reach) for start in STARTS)]
    correction = _correction(scan.map_from_sensor, found[0].map_from_sensor)
    features = _features(found, _sigmas(correction, covariance, surface))
    reason = _objection(features, surface)
    if reason is not None:
        return _fallback(scan, surface, reason, correction, features)
    return RegistrationOutcome("accepted", "it fits the map", found[0].map_from_sensor, correction, features)


def _covariance(scan: Scan) -> Array:
    """The stated covariance (6, 6), or what is assumed."""
    if scan.covariance is not None:
        return scan.covariance
    return np.diag(np.repeat([ASSUMED_SIGMA_M**2, ASSUMED_SIGMA_RAD**2], 3))


def _plane_mask() -> Array:
    mask = np.zeros(6)
    mask[PLANE] = 1.0
    return mask


def _correction(stated: Pose, found: Pose) -> Array:
    """What was added to a stated pose (6,), in the map's axes."""
    rotation = Pose(found.rotation @ stated.rotation.T, np.zeros(3)).rotation_vector
    return np.concatenate([found.translation - stated.translation, rotation])


def _sigmas(correction: Array, covariance: Array, surface: Surface) -> float:
    """How unlikely a correction is: the chi-square of its free numbers, as the deviation of a single one."""
    own = np.diag(np.repeat([(surface.spacing_m / 2) ** 2, OWN_SIGMA_RAD**2], 3))
    free = PLANE if surface.flat else list(range(6))
    expected = (covariance + own)[np.ix_(free, free)]
    moved = correction[free]
    squared = float(moved @ np.linalg.solve(expected, moved))
    return float(np.sqrt(chdtri(1, chdtrc(len(free), squared))))


def _features(found: list[Alignment], sigmas: float) -> Features:
    apart = [_correction(found[0].map_from_sensor, other.map_from_sensor) for other in found[1:]]
    return Features(
        converged=all(each.converged for each in found),
        weakest=min(each.weakest for each in found),
        inliers=found[0].inliers,
        sigmas=sigmas,
        disagreement_m=max(float(np.linalg.norm(each[:3])) for each in apart),
        disagreement_rad=max(float(np.linalg.norm(each[3:])) for each in apart),
    )


def _objection(features: Features, surface: Surface) -> str | None:
    """Why an alignment is not to be believed."""
    if not features.converged:
        return "the alignment did not come to rest"
    if features.inliers < MIN_INLIERS:
        return "too few points of the scan meet the map"
    if features.weakest < (MIN_WEAKEST_FLAT if surface.flat else MIN_WEAKEST):
        return "the scan can slide along the map, as in a bare corridor"
    if features.sigmas > MAX_SIGMAS:
        return "the correction is larger than the covariance allows"
    if (
        features.disagreement_m > MAX_DISAGREEMENT_CELLS * surface.spacing_m
        or features.disagreement_rad > MAX_DISAGREEMENT_RAD
    ):
        return "other starts end elsewhere"
    return None


def _fallback(
    scan: Scan, surface: Surface, reason: str, correction: Array | None = None, features: Features | None = None
) -> RegistrationOutcome:
    """The stated pose where it is good to half a cell, else none."""
    good = _sigma_m(scan, surface.flat) < surface.spacing_m / 2
    return RegistrationOutcome(
        "raw_pose" if good else "quarantined", reason, scan.map_from_sensor, correction, features
    )


def _sigma_m(scan: Scan, flat: bool) -> float:
    """The standard deviation of the scan's points, in metres: the pose's, with that of its rotation at median range."""
    covariance, ranges = _covariance(scan), scan.ranges
    shift, angle = (PLANE[:2], PLANE[2:]) if flat else ([0, 1, 2], [3, 4, 5])
    widest = [float(np.linalg.eigvalsh(covariance[np.ix_(part, part)])[-1]) for part in (shift, angle)]
    arm = float(np.median(np.minimum(ranges, scan.max_range_m))) if len(ranges) else 0.0
    return float(np.sqrt(max(0.0, widest[0]) + max(0.0, widest[1]) * arm**2))

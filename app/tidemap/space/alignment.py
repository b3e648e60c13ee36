"""Alignment: the pose from which a scan fits known surfaces best.

Point-to-plane ICP (Chen and Medioni, 1992) by small_gicp (Koide, JOSS 2024), coarse to fine, and at last without the
points that are off the surfaces (trimmed ICP, Chetverikov et al., ICPR 2002): a door that stands open before its wall
would draw the whole scan towards it. Whatever is flat is lifted to three layers, so that its lines are walls and it
moves in its plane alone.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import small_gicp
from numpy.typing import NDArray

from tidemap.space.pose import Array, Pose

COARSE, FINE = 5.0, 2.5
"""How far apart, in lengths of a cell, a point and its surface may be: first, and then."""
TRIMMED = 0.75
"""At last, points further than so many lengths of a cell off the plane of their surface are left out."""
ROUNDS, ITERATIONS = 10, 2
"""Of each of the three: what has not converged by then is lost. small_gicp lets no other thread run meanwhile, 5 to 14
ms an iteration; between rounds they do. Measured: beside a sweep of 70,000 points another thread waits for 13 ms of its
processor time at the 99th percentile, and for 24 where a round is four iterations; the sweep takes the same."""
NEIGHBOURS = 20
"""Cells that the normal of a surface is estimated from."""
MAX_POINTS, MAX_ROUGH_POINTS = 12_000, 3_000
"""Points of a scan that take part, for the answer and where a rough one will do; more are thinned evenly."""
MAX_THINNED_POINTS = 200_000
"""Points that are looked at for that; of more every second, third and so on."""
AXES, FLAT_AXES, FIRST_SHIFT = [0, 1, 2, 3, 4, 5], [2, 3, 4], 3
"""Of small_gicp's six unknowns (rotation, then translation) those that are free, in space and in the plane."""


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """Where an alignment ended: `map_from_sensor`, whether it came to rest, and how many points met a surface.

    weakest: how firmly those hold the scan in the direction in which they do least, 0 (not at all, as along a bare
    corridor) to 1: the smallest eigenvalue of the translation's Schur complement in the normal equations, a point.
    """

    map_from_sensor: Pose
    converged: bool
    inliers: int
    weakest: float


@dataclass(frozen=True, slots=True, eq=False)
class SourceCloud:
    """Points of a scan about its sensor, thinned, with the map's axes; `stated` is the pose that they came with."""

    cloud: small_gicp.PointCloud
    stated: Pose


class Surface:
    """Centres (n, 3) of occupied cells, in metres about `origin` (3,), as surfaces that scans are aligned to.

    `flat`: heights are left out, of scans too.
    """

    def __init__(self, centres: Array, origin: Array, spacing_m: float, flat: bool) -> None:
        self.n_points = len(centres)
        self.spacing_m, self.flat = spacing_m, flat
        self._origin = origin
        self._centres = centres * _used(flat)

    @cached_property
    def _known(self) -> tuple[small_gicp.PointCloud, small_gicp.KdTree]:
        """The cloud with its normals, and its tree; 5 µs a cell."""
        cloud = _cloud(self._centres, self.spacing_m, self.flat)
        tree = small_gicp.KdTree(cloud)
        small_gicp.estimate_normals(cloud, tree, num_neighbors=NEIGHBOURS)
        return cloud, tree

    @property
    def nbytes(self) -> int:
        """Memory that it takes, in bytes: centres, points, normals and the tree."""
        return self.n_points * _layers(self.flat) * 160

    def source(self, points: NDArray[np.floating], stated: Pose, most: int = MAX_POINTS) -> SourceCloud:
        """A scan's points (n, 3) in the sensor's frame, at most so many of them, ready to be aligned from a pose near
        the stated one."""
        points = points[:: -(-len(points) // MAX_THINNED_POINTS)]
        rotated = Pose(stated.rotation, np.zeros(3)).apply(points) * _used(self.flat)
        return SourceCloud(_cloud(_thinned(rotated, self.spacing_m / 2, most), self.spacing_m, self.flat), stated)

    def align(self, source: SourceCloud, shift: Array) -> Alignment:
        """Align from the stated pose, shifted (6,) by x, y, z in metres and a rotation vector in radians."""
        stated = source.stated
        about = (stated.translation + shift[:3] - self._origin) * _used(self.flat)
        start = self._fit(source.cloud, Pose.of_rotation_vector(shift[3:], about).matrix, COARSE).T_target_source
        start = self._fit(source.cloud, start, FINE).T_target_source
        result = self._fit(self._trimmed(source.cloud, start), start, FINE)
        start = result.T_target_source
        rotation, translation = start[:3, :3], start[:3, 3] + self._origin
        if self.flat:
            rotation, translation = _in_plane(rotation), np.array([*translation[:2], stated.translation[2]])
        pose = Pose(rotation @ stated.rotation, translation)
        inliers = int(result.num_inliers)
        weakest = _weakest(result.H, inliers, self.flat)
        return Alignment(pose, bool(result.converged), inliers // _layers(self.flat), weakest)

    def _fit(self, scan: small_gicp.PointCloud, start: Array, distance: float) -> small_gicp.RegistrationResult:
        """A scan aligned from a start (4, 4), with partners up to so many lengths of a cell away, in rounds until it
        comes to rest."""
        cloud, tree = self._known
        for _ in range(ROUNDS):
            result = small_gicp.align(
                cloud,
                scan,
                tree,
                start,
                registration_type="PLANE_ICP",
                max_correspondence_distance=distance * self.spacing_m,
                max_iterations=ITERATIONS,
            )
            if result.converged:
                break
            start = result.T_target_source
        return result

    def _trimmed(self, scan: small_gicp.PointCloud, at: Array) -> small_gicp.PointCloud:
        """Those points of a scan, moved by (4, 4), that are near the plane of the surface next to them; all where that
        leaves too few."""
        cloud, tree = self._known
        points = np.asarray(scan.points())
        moved = points @ at.T
        nearest = np.asarray(tree.batch_nearest_neighbor_search(moved)[0])
        apart = moved - np.asarray(cloud.points())[nearest]
        off = np.abs(np.einsum("ij,ij->i", apart, np.asarray(cloud.normals())[nearest]))
        near = off <= TRIMMED * self.spacing_m
        return scan if near.sum() < NEIGHBOURS else small_gicp.PointCloud(np.ascontiguousarray(points[near, :3]))


def _used(flat: bool) -> Array:
    """(3,) 1 for the axes that count, 0 for others."""
    return np.array([1.0, 1.0, 0.0 if flat else 1.0])


def _layers(flat: bool) -> int:
    """How often each point is in a cloud."""
    return 3 if flat else 1


def _cloud(points: Array, spacing_m: float, flat: bool) -> small_gicp.PointCloud:
    """Points (n, 3); flat ones in three layers."""
    if flat:
        points = np.concatenate([points + np.array([0.0, 0.0, height]) for height in (-spacing_m, 0.0, spacing_m)])
    return small_gicp.PointCloud(np.ascontiguousarray(points, np.float64))


def _thinned(points: Array, size: float, most: int) -> Array:
    """The means of points (n, 3) in boxes of a size, or of larger ones so that they are few enough."""
    found = points
    while True:
        found = np.asarray(small_gicp.voxelgrid_sampling(found, size).points())[:, :3]
        if len(found) <= most:
            return found
        # On surfaces their number falls with the square of the size.
        size *= max(1.2, np.sqrt(len(found) / most))


def _in_plane(rotation: Array) -> Array:
    """The part about z of a rotation (3, 3)."""
    length = np.hypot(rotation[0, 0] + rotation[1, 1], rotation[1, 0] - rotation[0, 1])
    cosine, sine = (rotation[0, 0] + rotation[1, 1]) / length, (rotation[1, 0] - rotation[0, 1]) / length
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def _weakest(hessian: Array, inliers: int, flat: bool) -> float:
    """`Alignment.weakest` of the normal equations (6, 6)."""
    free = FLAT_AXES if flat else AXES
    first = free.index(FIRST_SHIFT)
    known = np.asarray(hessian)[np.ix_(free, free)]
    rotations, both, shifts = known[:first, :first], known[:first, first:], known[first:, first:]
    left = shifts - both.T @ np.linalg.pinv(rotations, hermitian=True) @ both
    return max(0.0, float(np.linalg.eigvalsh(left)[0])) / max(1, inliers)

"""Poses are the group of rigid transforms, and what is none is refused in words."""

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from scipy.spatial.transform import Rotation

from tests.unit.spectral.real import needed
from tidemap.space.pose import Pose

METRES = st.floats(-1e3, 1e3)
TRANSLATIONS = arrays.arrays(np.float64, 3, elements=METRES)
POINTS = arrays.arrays(np.float64, st.tuples(st.integers(0, 20), st.just(3)), elements=METRES)
UNITS = (
    arrays.arrays(np.float64, 4, elements=st.floats(-1, 1))
    .filter(lambda q: bool(np.linalg.norm(q) > 1e-3))
    .map(lambda q: q / np.linalg.norm(q))
)
POSES = st.builds(Pose.of_quaternion, TRANSLATIONS, UNITS)
IDENTITY = Pose(np.eye(3), np.zeros(3))
quick = settings(max_examples=60)


def same(one: Pose, other: Pose) -> None:
    np.testing.assert_allclose(one.matrix, other.matrix, rtol=0, atol=1e-9)


@quick
@given(POSES, POSES, POSES)
def test_poses_are_a_group(a: Pose, b: Pose, c: Pose) -> None:
    same((a @ b) @ c, a @ (b @ c))
    same(a @ IDENTITY, a)
    same(IDENTITY @ a, a)
    same(a @ a.inverse, IDENTITY)
    same(a.inverse @ a, IDENTITY)
    same((a @ b).inverse, b.inverse @ a.inverse)


@quick
@given(POSES, POSES, POINTS)
def test_points_go_through_two_poses_as_through_their_product(a: Pose, b: Pose, points: np.ndarray) -> None:
    np.testing.assert_allclose((a @ b).apply(points), a.apply(b.apply(points)), rtol=0, atol=1e-9)
    np.testing.assert_allclose(a.inverse.apply(a.apply(points)), points, rtol=0, atol=1e-9)
    homogeneous = np.column_stack([points, np.ones(len(points))])
    np.testing.assert_allclose(a.apply(points), (homogeneous @ a.matrix.T)[:, :3], rtol=0, atol=1e-9)


@quick
@given(POSES, POINTS)
def test_distances_and_hands_stay(pose: Pose, points: np.ndarray) -> None:
    np.testing.assert_allclose(pose.rotation @ pose.rotation.T, np.eye(3), rtol=0, atol=1e-12)
    assert np.linalg.det(pose.rotation) == pytest.approx(1)
    before, after = (np.linalg.norm(each - each[:1], axis=1) for each in (points, pose.apply(points)))
    np.testing.assert_allclose(after, before, rtol=1e-9, atol=1e-9)


@quick
@given(POSES, POINTS, st.integers(0, 20))
def test_a_row_is_the_same_in_any_batch(pose: Pose, points: np.ndarray, cut: int) -> None:
    parts = np.concatenate([pose.apply(points[:cut]), pose.apply(points[cut:])])
    assert parts.tobytes() == pose.apply(points).tobytes()


@quick
@given(TRANSLATIONS, UNITS)
def test_a_quaternion_is_the_rotation_that_scipy_makes(translation: np.ndarray, quaternion: np.ndarray) -> None:
    pose = Pose.of([*translation, *quaternion])
    np.testing.assert_allclose(pose.rotation, Rotation.from_quat(quaternion).as_matrix(), rtol=0, atol=1e-12)
    same(pose, Pose.of([*translation, *-quaternion]))
    same(pose, Pose.of(pose.matrix))
    assert pose.translation.tolist() == translation.tolist()


@quick
@given(TRANSLATIONS, UNITS)
def test_rounded_numbers_are_still_a_rotation(translation: np.ndarray, quaternion: np.ndarray) -> None:
    exact = Pose.of_quaternion(translation, quaternion)
    for rounded in (Pose.of(exact.matrix.round(3)), Pose.of([*translation, *quaternion.round(3)])):
        np.testing.assert_allclose(rounded.rotation @ rounded.rotation.T, np.eye(3), rtol=0, atol=1e-12)
        np.testing.assert_allclose(rounded.rotation, exact.rotation, rtol=0, atol=5e-3)


def test_a_pose_keeps_no_view_of_what_it_was_made_of() -> None:
    matrix = np.eye(4)
    pose = Pose.of(matrix)
    matrix[:] = 7
    same(pose, IDENTITY)


def test_the_real_transform_is_a_pose() -> None:
    matrix = np.loadtxt(needed("lidar_pair", "T_target_source.txt"))
    np.testing.assert_allclose(Pose.of(matrix).matrix, matrix, rtol=0, atol=1e-5)


def changed(*entries: tuple[int, int, float]) -> np.ndarray:
    matrix = np.eye(4)
    for row, column, value in entries:
        matrix[row, column] = value
    return matrix


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ([0.0] * 7, "no rotation"),
        ([0, 0, 0, 0, 0, 0, 2], "norm 2"),
        ([0, 0, 0, 0, 0, 0, 1e300], "norm"),
        ([0, 0, float("nan"), 0, 0, 0, 1], "NaN"),
        ([0, 0, 0, 0, 0, float("inf"), 1], "infinite"),
        (changed((0, 3, float("nan"))), "NaN"),
        (changed((0, 0, 2.0)), "no rotation"),
        (changed((0, 1, 0.5)), "no rotation"),
        (changed((0, 0, 1e300)), "no rotation"),
        (changed((0, 0, 0.0)), "no rotation"),
        (changed((0, 0, -1.0)), "mirrors"),
        (changed((3, 0, 1.0)), "last row"),
        (np.eye(3), "shape"),
        ([0, 0, 0], "shape"),
        ("here", "4x4 matrix of numbers"),
        ([[1, 2], [3]], "4x4 matrix of numbers"),
    ],
)
def test_what_is_no_rigid_transform_is_refused(values: Sequence[object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Pose.of(values)  # type: ignore[arg-type]

"""Transforms over time, as tf has them: scipy's slerp is the truth."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from tests.property.test_pose import POSES, UNITS
from tidemap.space.pose import Pose
from tidemap.space.transforms import MissingTransformError, TransformTree

HALF = (0.0, 0.0, np.sin(np.pi / 4), np.cos(np.pi / 4))
NONE = (0.0, 0.0, 0.0, 1.0)


@settings(max_examples=60)
@given(UNITS, UNITS, st.floats(0, 1))
def test_a_pose_between_two_is_on_the_line_and_on_the_arc(
    one: np.ndarray[tuple[int], np.dtype[np.float64]],
    other: np.ndarray[tuple[int], np.dtype[np.float64]],
    share: float,
) -> None:
    tree = TransformTree()
    tree.add("map", "robot", 10.0, [0, 2, 4], one)
    tree.add("map", "robot", 12.0, [2, 2, 0], other)
    found = tree.lookup("map", "robot", 10.0 + 2 * share)
    assert found.translation == pytest.approx([2 * share, 2, 4 - 4 * share], abs=1e-9)
    truth = Slerp([0, 1], Rotation.from_quat([one, other]))(share)
    if (Rotation.from_quat(one).inv() * Rotation.from_quat(other)).magnitude() < np.pi - 1e-3:
        apart = (Rotation.from_matrix(found.rotation).inv() * truth).magnitude()
        assert apart < 1e-5  # nearly alike rotations are joined by a straight line


@settings(max_examples=30)
@given(POSES, POSES, POSES)
def test_transforms_are_chained_through_the_frame_that_both_share(a: Pose, b: Pose, c: Pose) -> None:
    tree = TransformTree()
    for parent, child, pose in (("map", "robot", a), ("robot", "laser", b), ("map", "door", c)):
        tree.add(parent, child, None, pose.translation, Rotation.from_matrix(pose.rotation).as_quat())
    for target, source, truth in (
        ("map", "laser", a @ b),
        ("laser", "map", (a @ b).inverse),
        ("door", "laser", c.inverse @ a @ b),
        ("robot", "robot", Pose(np.eye(3), np.zeros(3))),
    ):
        np.testing.assert_allclose(tree.lookup(target, source, 5.0).matrix, truth.matrix, atol=1e-6)


def test_times_may_come_in_any_order_and_frames_with_a_slash() -> None:
    tree = TransformTree()
    for time in (3.0, 1.0, 2.0):
        tree.add("/map", "/robot", time, [time, 0, 0], NONE)
    for time in (1.0, 1.25, 2.0, 3.0):
        assert tree.lookup("map", "robot", time).translation[0] == pytest.approx(time)
    tree.add("map", "robot", 0.0, [0, 0, 0], HALF)
    assert tree.lookup("map", "/robot", 0.0).apply([[1, 0, 0]])[0] == pytest.approx([0, 1, 0])


def test_what_is_missing_is_said() -> None:
    tree = TransformTree()
    assert not tree
    tree.add("odom", "robot", 1.0, [0, 0, 0], NONE)
    tree.add("odom", "robot", 2.0, [0, 0, 0], NONE)
    tree.add("robot", "laser", None, [0, 0, 0], NONE)
    for time in (0.5, 2.5):
        with pytest.raises(MissingTransformError, match=r"'robot' to 'odom' is known from 1\.000000 to 2\.000000 s"):
            tree.lookup("odom", "laser", time)
    with pytest.raises(
        MissingTransformError, match="from the frame 'laser' to 'map'; known are 'laser', 'odom', 'robot'"
    ):
        tree.lookup("map", "laser", 1.5)
    with pytest.raises(ValueError, match="two parents, 'odom' and 'map'"):
        tree.add("map", "robot", 3.0, [0, 0, 0], NONE)
    with pytest.raises(ValueError, match="Normalise"):
        tree.add("map", "other", 3.0, [0, 0, 0], (1, 1, 1, 1))
    with pytest.raises(ValueError, match="NaN"):
        tree.add("map", "other", 3.0, [np.nan, 0, 0], NONE)


def test_a_circle_of_frames_ends() -> None:
    tree = TransformTree()
    tree.add("a", "b", None, [0, 0, 0], NONE)
    tree.add("b", "a", None, [0, 0, 0], NONE)
    with pytest.raises(MissingTransformError, match="its own parent"):
        tree.lookup("map", "a", 0.0)

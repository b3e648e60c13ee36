"""Transforms over time: a tree of frames, as robots publish it (`tf`)."""

from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tidemap.space.pose import Pose

MAX_FRAMES = 10_000
MAX_DEPTH = 1000
"""Frames on the way to the root."""
NEARLY_ALIKE = 0.9995
"""The cosine of half an angle from which on a straight line stands for the arc."""


class MissingTransformError(ValueError):
    """Two frames are not connected, or not at that time."""


@dataclass(slots=True, eq=False)
class _Edge:
    """`parent_from_child` over time: 7 numbers a time, x, y, z and the quaternion x, y, z, w; `static` at all times."""

    parent: str
    static: bool
    time: "array[float]" = field(default_factory=lambda: array("d"))
    values: "array[float]" = field(default_factory=lambda: array("d"))
    is_sorted: bool = True

    def add(self, time: float, values: NDArray[np.float64]) -> None:
        self.is_sorted &= not self.time or time >= self.time[-1]
        self.time.append(time)
        self.values.extend(values)

    def at(self, time: float) -> Pose | None:
        """The transform at a time, interpolated; None before the first and after the last."""
        times, values = np.frombuffer(self.time), np.frombuffer(self.values).reshape(-1, 7)
        if self.static:
            return Pose.of(values[-1])
        if not self.is_sorted:
            order = np.argsort(times, kind="stable")
            self.time, self.values = array("d", times[order]), array("d", values[order].ravel())
            self.is_sorted = True
            return self.at(time)
        after = int(np.searchsorted(times, time))
        if after == len(times) or (after == 0 and times[0] != time):
            return None
        if times[after] == time:
            return Pose.of(values[after])
        share = (time - times[after - 1]) / (times[after] - times[after - 1])
        return _between(values[after - 1], values[after], float(share))


class TransformTree:
    """Where frames were to one another."""

    def __init__(self) -> None:
        self._edges: dict[str, _Edge] = {}

    def __bool__(self) -> bool:
        return bool(self._edges)

    def add(self, parent: str, child: str, time: float | None, translation: ArrayLike, quaternion: ArrayLike) -> None:
        """`parent_from_child` at a time, or at all times (None): translation (3,) and quaternion (x, y, z, w).

        Raises ValueError for what is no transform, and for a frame with two parents.
        """
        parent, child = parent.lstrip("/"), child.lstrip("/")
        Pose.of_quaternion(translation, quaternion)
        edge = self._edges.setdefault(child, _Edge(parent, time is None))
        if edge.parent != parent:
            raise ValueError(f"the frame {child!r} has two parents, {edge.parent!r} and {parent!r}; leave one out")
        if len(self._edges) > MAX_FRAMES:
            raise ValueError(f"there are more than {MAX_FRAMES} frames")
        edge.add(0.0 if time is None else time, np.concatenate([translation, quaternion]).astype(np.float64))

    def frames(self) -> list[str]:
        """All frames, in order of their names."""
        return sorted({*self._edges, *(edge.parent for edge in self._edges.values())})

    def lookup(self, target: str, source: str, time: float) -> Pose:
        """`target_from_source` at a time. Raises MissingTransformError."""
        target, source = target.lstrip("/"), source.lstrip("/")
        up, down = list(self._to_root(source)), list(self._to_root(target))
        shared = next((frame for frame in up if frame in down), None)
        if shared is None:
            raise MissingTransformError(
                f"no transform leads from the frame {source!r} to {target!r}; known are {_listed(self.frames())}"
            )
        shared_from_target = self._climb(down[: down.index(shared)], time)
        return shared_from_target.inverse @ self._climb(up[: up.index(shared)], time)

    def _to_root(self, frame: str) -> Iterator[str]:
        for _ in range(MAX_DEPTH):
            yield frame
            if frame not in self._edges:
                return
            frame = self._edges[frame].parent
        raise MissingTransformError(f"the frame {frame!r} is its own parent, over others or directly")

    def _climb(self, frames: list[str], time: float) -> Pose:
        """From the first frame to the parent of the last."""
        found = Pose(np.eye(3), np.zeros(3))
        for frame in frames:
            edge = self._edges[frame]
            step = edge.at(time)
            if step is None:
                first, last = min(edge.time), max(edge.time)
                raise MissingTransformError(
                    f"the transform from {frame!r} to {edge.parent!r} is known from {first:.6f} to {last:.6f} s, "
                    f"not at {time:.6f}"
                )
            found = step @ found
        return found


def _listed(names: list[str]) -> str:
    return ", ".join(map(repr, names[:20])) or "no frames at all"


def _between(one: NDArray[np.float64], other: NDArray[np.float64], share: float) -> Pose:
    """A share of the way: along the line, and along the arc between the rotations (Shoemake, 1985)."""
    translation = one[:3] + share * (other[:3] - one[:3])
    start, end = (each[3:] / np.linalg.norm(each[3:]) for each in (one, other))
    cosine = float(start @ end)
    if cosine < 0:
        end, cosine = -end, -cosine
    if cosine > NEARLY_ALIKE:
        quaternion = start + share * (end - start)
    else:
        angle = np.arccos(cosine)
        quaternion = (np.sin((1 - share) * angle) * start + np.sin(share * angle) * end) / np.sin(angle)
    return Pose.of_quaternion(translation, quaternion / np.linalg.norm(quaternion))

"""Frames in the scene: what comes and goes is sent, and nothing else."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import viser
from hypothesis import given
from hypothesis import strategies as st

from tests.unit.web.states import GRID
from tidemap_web.viewer.layout import Bounds, arrange
from tidemap_web.viewer.scene import Box, Scene

BOXES = [Box((i, 0.0, 0.0, i + 1.0, 1.0, 1.0), f"occupied · {i} cells", (213, 94, 0)) for i in range(4)]
LAYOUT = arrange(
    Bounds.of(GRID, GRID.index(np.arange(GRID.n_cells)).astype(np.int32)), False, ("Predicted", "Observed")
)


class Drawn:
    """What a browser has been sent, as far as frames need it."""

    def __init__(self) -> None:
        self.names: set[str] = set()
        self.sent = 0

    def add_line_segments(self, name: str, *_: Any, **__: Any) -> None:
        self.names.add(name)
        self.sent += 1

    def add_label(self, name: str, *_: Any, **__: Any) -> None:
        assert name.rsplit("/", 1)[0] in self.names
        self.names.add(name)

    def remove_by_name(self, name: str) -> None:
        self.names = {each for each in self.names if each != name and not each.startswith(f"{name}/")}


@given(st.lists(st.lists(st.sampled_from(BOXES), unique=True), min_size=1, max_size=6))
def test_frames_that_stay_are_not_sent_again(views: list[list[Box]]) -> None:
    drawn = Drawn()
    scene = Scene(cast(viser.ClientHandle, SimpleNamespace(scene=drawn)))
    scene.layout = LAYOUT
    before: list[Box] = []
    for boxes in views:
        drawn.sent = 0
        scene.outline(tuple(boxes))
        frames = [name for name in drawn.names if not name.endswith("/label")]
        labels = [name for name in drawn.names if name.endswith("/label")]
        assert len(frames) == 2 * len(boxes)
        assert len(labels) == len(boxes)
        assert all(name.startswith("/observed/") for name in labels)
        assert drawn.sent == 2 * len(set(boxes) - set(before))
        before = boxes

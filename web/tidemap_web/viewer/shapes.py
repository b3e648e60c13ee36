"""Shapes of the scene: words and frames, lines of one thickness, markers."""

from typing import Final, Literal

import numpy as np
import viser
from numpy.typing import NDArray

from tidemap_web.viewer import colors

Vector = NDArray[np.float64]
Anchor = Literal["bottom-center", "top-center"]
_EDGES: Final = np.array(
    [[0, 1], [0, 2], [1, 3], [2, 3], [4, 5], [4, 6], [5, 7], [6, 7], [0, 4], [1, 5], [2, 6], [3, 7]], dtype=np.intp
)
_CORNERS: Final = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)


def add_label(
    scene: viser.SceneApi, name: str, text: str, at: Vector, size: float, anchor: Anchor = "bottom-center"
) -> None:
    """Words at (3,) metres, which their `anchor` is at; `size` 1 is that of other words of a page."""
    position = (float(at[0]), float(at[1]), float(at[2]))
    scene.add_label(name, text, position=position, anchor=anchor, font_screen_scale=size)


def add_frame(scene: viser.SceneApi, name: str, centre: Vector, half: Vector, color: colors.Rgb) -> None:
    """The edges of a box around `centre` (3,), `half` (3,) of its sides long, in metres."""
    add_lines(scene, name, (centre + _CORNERS * half)[_EDGES], color)


def add_lines(scene: viser.SceneApi, name: str, segments: Vector, color: colors.Rgb) -> None:
    """Segments (n, 2, 3) in metres."""
    scene.add_line_segments(name, segments, np.array(color, np.uint8), thickness=2.5, thickness_units="screen")


def add_markers(scene: viser.SceneApi, name: str, points: Vector, each: NDArray[np.uint8], size_m: float) -> None:
    """Discs at (n, 3) metres in colours (n, 3)."""
    scene.add_point_cloud(
        name, points, each, point_size=size_m, point_shape="circle", point_shading="flat", precision="float32"
    )

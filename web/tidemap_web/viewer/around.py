"""Draws what is around the cells of a grid: markers of doors and rooms, and the tracks of sensors."""

from typing import Final

import numpy as np
import viser

from tidemap_web.viewer import colors
from tidemap_web.viewer.layout import Layout
from tidemap_web.viewer.shapes import add_label, add_lines, add_markers
from tidemap_web.viewer.surroundings import NOBODY, Around, Track

NAME_SIZE: Final = 0.8
MAX_LABELS: Final = 40
"""Markers with their names beside them: more would hide one another, and the pointer says them."""


class AroundDrawing:
    """What is drawn of it; only what has changed is drawn again."""

    def __init__(self, scene: viser.SceneApi, names: tuple[str, ...]) -> None:
        self._scene = scene
        self._names = names
        self._drawn = NOBODY

    def clear(self) -> None:
        """The grids have gone, and all in them."""
        self._drawn = NOBODY

    def show(self, around: Around, layout: Layout) -> None:
        """Draw markers in every grid, with labels and tracks in the last."""
        before, self._drawn = self._drawn, around
        if around.markers != before.markers:
            self._show_markers(around, layout)
        same = len(around.tracks) == len(before.tracks)
        if not same or not all(one.same_as(other) for one, other in zip(around.tracks, before.tracks, strict=True)):
            self._show_tracks(around, layout)

    def _show_markers(self, around: Around, layout: Layout) -> None:
        for side in range(1 + layout.beside):
            name = f"/{self._names[side]}/markers"
            self._scene.remove_by_name(name)
            if not around.markers:
                continue
            points = around.positions + layout.shift * side
            each = np.array([marker.colors[side] for marker in around.markers], np.uint8)
            add_markers(self._scene, f"{name}/points", points, each, layout.marker_m)
            last = side == layout.beside
            for number, marker in enumerate(around.markers[:MAX_LABELS] if last else ()):
                above = points[number] + [0.0, 1.2 * layout.marker_m, 1.2 * layout.marker_m]
                add_label(self._scene, f"{name}/{number}", marker.name, above, NAME_SIZE)

    def _show_tracks(self, around: Around, layout: Layout) -> None:
        side = int(layout.beside)
        name = f"/{self._names[side]}/tracks"
        self._scene.remove_by_name(name)
        for number, track in enumerate(around.tracks):
            self._show_track(f"{name}/{number}", track, layout, side)

    def _show_track(self, name: str, track: Track, layout: Layout, side: int) -> None:
        points = track.points + layout.shift * side
        if len(points) > 1:
            add_lines(self._scene, f"{name}/path", np.stack([points[:-1], points[1:]], axis=1), colors.TRACK)
        each = np.full(points.shape, colors.TRACK, np.uint8)
        add_markers(self._scene, f"{name}/poses", points, each, layout.marker_m / 3)
        size = 2 * layout.marker_m
        self._scene.add_frame(
            f"{name}/pose",
            axes_length=size,
            axes_radius=size / 16,
            origin_color=colors.TRACK,
            wxyz=track.wxyz,
            position=points[-1],
        )
        add_label(self._scene, f"{name}/label", track.source or "sensor", points[-1] + [0.0, 0.0, size], NAME_SIZE)

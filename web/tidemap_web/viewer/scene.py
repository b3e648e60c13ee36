"""One browser tab's 3D scene: the tiles of one or two grids, the floor under them, labels, frames and axes."""

import math
from dataclasses import dataclass
from itertools import count
from typing import Final

import numpy as np
import viser
from numpy.typing import NDArray

from tidemap_web.viewer import colors
from tidemap_web.viewer.around import AroundDrawing
from tidemap_web.viewer.board import Board, Picture
from tidemap_web.viewer.layout import Layout, camera_pose
from tidemap_web.viewer.painting import RESHAPED
from tidemap_web.viewer.picking import Ray, rotation
from tidemap_web.viewer.shapes import add_frame, add_label
from tidemap_web.viewer.surroundings import Around

CELL_HALF = 0.42
"""Half the side of a drawn square in grid steps: a little less than a cell, so that cells show apart."""

_FOV: Final = 0.7
_FLAT_FOV: Final = 0.02
"""From above it is seen from so far that verticals are points: what is 3 m higher moves by 3 cm at the edge at most."""
_NEAR: Final = 0.01
_FAR: Final = 1000.0
_STILL_M = 0.02
"""Less is no movement of the camera."""
_GRIDS = ("predicted", "observed")
"""The left grid and the right one."""


@dataclass(frozen=True, slots=True)
class Box:
    """A frame around [x0, y0, z0, x1, y1, z1] in metres, with words above it."""

    bounds: tuple[float, ...]
    text: str
    color: colors.Rgb


def _frame(side: int, number: int) -> str:
    """The name of an event's frame in one grid."""
    return f"/{_GRIDS[side]}/events/{number}"


class Scene:
    """What one client sees. Used by its session's worker only."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self.client = client
        self.layout: Layout | None = None
        self._tiles: dict[tuple[int, int], viser.PointCloudHandle] = {}
        self._selected: tuple[int, ...] | None = None
        self._events: dict[Box, int] = {}
        self._numbers = count()
        self.placed = False
        """Whether the camera has been put anywhere."""
        self._standard: list[float] | None = None
        self._around = AroundDrawing(client.scene, _GRIDS)
        self._crop: tuple[float, ...] | None = None

    def clear(self) -> None:
        """Take everything away."""
        for name in _GRIDS:
            self.client.scene.remove_by_name(f"/{name}")
        self._tiles = {}
        self._selected = None
        self._events = {}
        self._around.clear()
        self._crop = None
        self.layout = None

    def build(self, layout: Layout) -> None:
        """Lay the floors out; there are no cells yet."""
        self.clear()
        self.layout = layout
        for side in range(1 + layout.beside):
            self._lay_floor(_GRIDS[side], layout.titles[side], layout, layout.shift * side)

    def aim(self, from_above: bool) -> None:
        """Put the camera where all grids are in view; from above they are seen as on a plan."""
        if self.layout is None:
            return
        camera, fov = self.client.camera, _FLAT_FOV if from_above else _FOV
        aspect = camera.image_width / max(camera.image_height, 1)
        pose = camera_pose(self.layout, aspect, fov, from_above)
        standard = [*pose.position.tolist(), *pose.look_at.tolist(), fov]
        self.put_camera(standard)
        self._standard = standard

    def put_camera(self, pose: list[float]) -> None:
        """Put the camera at the first three metres, looking at the next three, with a vertical field of view in radians
        where that is given."""
        camera = self.client.camera
        self._standard, self.placed = None, True
        position, look_at = np.array(pose[:3]), np.array(pose[3:6])
        fov = pose[6] if len(pose) > 6 else _FOV
        away = float(np.linalg.norm(position - look_at))
        far = fov < _FOV
        camera.near, camera.far = (away / 30, away * 4) if far else (_NEAR, _FAR)
        camera.max_orbit_distance = max(1e4, 4 * away)
        camera.fov = fov
        camera.up_direction = np.array([0.0, 0.0, 1.0])
        camera.position, camera.look_at = position, look_at

    def pose(self) -> list[float] | None:
        """Where the camera is, what it looks at and its field of view where that is not the usual one; None where it is
        a standard view."""
        camera = self.client.camera
        pose = [*camera.position.tolist(), *camera.look_at.tolist(), camera.fov]
        if self._standard is not None and np.allclose(pose, self._standard, atol=_STILL_M * (pose[6] / _FOV)):
            return None
        return pose[:6] if math.isclose(pose[6], _FOV, abs_tol=1e-3) else pose

    def ray(self, at: tuple[float, float]) -> Ray:
        """From the camera through a point of its picture, from (0, 0), top left, to (1, 1)."""
        camera = self.client.camera
        half = math.tan(camera.fov / 2)
        through = np.array([(2 * at[0] - 1) * half * camera.aspect, (2 * at[1] - 1) * half, 1.0])
        direction = rotation(camera.wxyz) @ through
        return Ray.of(tuple(camera.position), tuple(direction / np.linalg.norm(direction)), camera.wxyz)

    def show(self, board: Board, picture: Picture) -> None:
        """Draw what has changed; only that is sent."""
        for side, tile in np.argwhere(picture.changed).tolist():
            reshaped = bool(picture.changed[side, tile] & RESHAPED)
            self._draw_tile(board, side, tile, reshaped)

    def show_all(self, board: Board) -> None:
        """Draw every tile, as in a scene that has just been built, or of another board."""
        for (_, tile), handle in self._tiles.items():
            handle.visible = tile < board.n_tiles
        for side in range(len(_GRIDS)):
            for tile in range(board.n_tiles):
                self._draw_tile(board, side, tile, reshaped=True)

    def outline(self, boxes: tuple[Box, ...]) -> None:
        """Frame what is abnormal, in every grid, in the last with a label above; only what comes or goes is sent."""
        if self.layout is None:
            return
        for box in self._events.keys() - set(boxes):
            number = self._events.pop(box)
            for side in range(1 + self.layout.beside):
                self.client.scene.remove_by_name(_frame(side, number))
        for box in boxes:
            if box not in self._events:
                self._events[box] = number = next(self._numbers)
                self._frame_event(box, number, self.layout)

    def _frame_event(self, box: Box, number: int, layout: Layout) -> None:
        low, high = np.array(box.bounds[:3]), np.array(box.bounds[3:])
        centre, margin = (low + high) / 2, 0.15 * layout.grid.resolution_m
        for side in range(1 + layout.beside):
            at, half = centre + layout.shift * side, (high - low) / 2 + margin
            add_frame(self.client.scene, _frame(side, number), at, half, box.color)
        # Once: labels have a size of their own, and may hide one another.
        top = np.array([*centre[:2], high[2] + margin]) + layout.shift * layout.beside
        add_label(self.client.scene, f"{_frame(layout.beside, number)}/label", box.text, top, 1.0)

    def surround(self, around: Around) -> None:
        """Draw doors, rooms and sensors."""
        if self.layout is not None:
            self._around.show(around, self.layout)

    def crop(self, bounds: tuple[float, ...] | None) -> None:
        """Frame what is left of a grid, [x0, y0, z0, x1, y1, z1] in metres; None where it is whole."""
        if self.layout is None or bounds == self._crop:
            return
        self._crop = bounds
        for side in range(1 + self.layout.beside):
            name = f"/{_GRIDS[side]}/crop"
            self.client.scene.remove_by_name(name)
            if bounds is not None:
                low, high = np.array(bounds[:3]), np.array(bounds[3:])
                centre = (low + high) / 2 + self.layout.shift * side
                add_frame(self.client.scene, name, centre, (high - low) / 2, colors.CROP)

    def select(self, index: NDArray[np.int64] | None) -> None:
        """Frame one cell (3,) in both grids, or none."""
        wanted = None if index is None else tuple(index.tolist())
        if self.layout is None or wanted == self._selected:
            return
        self._selected = wanted
        for name in _GRIDS:
            self.client.scene.remove_by_name(f"/{name}/selected")
        if index is None:
            return
        scene = self.client.scene
        half = np.full(3, self.layout.grid.resolution_m * 0.6)
        centre = self.layout.grid.centre_at(index)
        for side in range(1 + self.layout.beside):
            add_frame(scene, f"/{_GRIDS[side]}/selected", centre + self.layout.shift * side, half, colors.SELECTED)

    def send(self, wait_s: float) -> None:
        """Send what is queued and wait until the browser has taken it, for it answers in order.

        Raises TimeoutError when it does not answer, ConnectionError when it has gone.
        """
        self.client.flush()
        try:
            self.client.local_storage.get_item("tidemap", timeout=wait_s)
        except RuntimeError as error:  # also an answer: the browser keeps its storage closed
            if "disconnected" in str(error):
                raise ConnectionError(str(error)) from error

    def _draw_tile(self, board: Board, side: int, tile: int, reshaped: bool) -> None:
        rows = board.shown(side, tile)
        handle = self._tiles.get((side, tile))
        if handle is None:
            if len(rows):
                self._tiles[side, tile] = self._add_tile(board, side, tile, rows)
            return
        handle.visible = len(rows) > 0
        if handle.visible:
            if reshaped:
                handle.points = board.points(rows)
            handle.colors = board.colors(side, rows)

    def _add_tile(self, board: Board, side: int, tile: int, rows: NDArray[np.intp]) -> viser.PointCloudHandle:
        grid = board.grid
        shift = np.zeros(3) if self.layout is None else self.layout.shift * side
        return self.client.scene.add_point_cloud(
            f"/{_GRIDS[side]}/cells/{tile}",
            points=board.points(rows),
            colors=board.colors(side, rows),
            point_size=CELL_HALF,
            point_shape="square",
            point_shading="flat",
            precision="float16" if board.precision == np.float16 else "float32",
            scale=grid.resolution_m,
            position=np.asarray(grid.origin) + shift,
        )

    def _lay_floor(self, name: str, title: str, layout: Layout, shift: NDArray[np.float64]) -> None:
        size = layout.size
        step = layout.lines_m
        centre = (layout.low + layout.high) / 2 + shift
        bottom = layout.low[2] - (0.02 + 0.5 * layout.flat) * layout.grid.resolution_m
        self.client.scene.add_grid(
            f"/{name}/floor",
            width=float(size[0]),
            height=float(size[1]),
            cell_size=step,
            section_size=5 * step,
            cell_color=colors.FLOOR,
            section_color=colors.FLOOR,
            shadow_opacity=0.0,
            fade_distance=1e6,
            position=(centre[0], centre[1], bottom),
        )
        edge = np.array([size[0] / 2, size[1] / 2, 0.0])
        add_frame(self.client.scene, f"/{name}/outline", np.array([centre[0], centre[1], bottom]), edge, colors.FLOOR)
        add_label(
            self.client.scene,
            f"/{name}/label",
            title,
            np.array([centre[0], layout.high[1] + shift[1], layout.high[2]]),
            1.3,
        )
        for tick in layout.ticks():
            add_label(
                self.client.scene, f"/{name}/axes/{tick.name}", tick.text, np.array([*tick.at, bottom]) + shift, 0.8
            )

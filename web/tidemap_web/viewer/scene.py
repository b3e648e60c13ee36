"""One browser tab's 3D scene: two point clouds, the floor under them, labels and the selected cell."""

import numpy as np
import viser
from numpy.typing import NDArray

from tidemap_web.viewer import colors
from tidemap_web.viewer.cells import Cloud, Picture
from tidemap_web.viewer.layout import Layout, camera_pose

CELL_HALF = 0.42
"""Half the side of a drawn square in grid steps: a little less than a cell, so that cells show apart."""

_EXACT_FLOAT16 = 2048
_FOV = 0.7
_GRIDS = ("predicted", "observed")
_EDGES = np.array(
    [[0, 1], [0, 2], [1, 3], [2, 3], [4, 5], [4, 6], [5, 7], [6, 7], [0, 4], [1, 5], [2, 6], [3, 7]], dtype=np.intp
)


class Scene:
    """What one client sees. Used by its session's worker only."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self.client = client
        self.layout: Layout | None = None
        self._clouds: dict[str, viser.PointCloudHandle] = {}
        self._selected: tuple[int, ...] | None = None

    def clear(self) -> None:
        """Take everything away."""
        for name in _GRIDS:
            self.client.scene.remove_by_name(f"/{name}")
        self._clouds = {}
        self._selected = None
        self.layout = None

    def build(self, layout: Layout, extent: int) -> None:
        """Lay the floor and empty grids out for a location of at most `extent` cells a side."""
        self.clear()
        self.layout = layout
        for name in _GRIDS:
            shift = layout.shift if name == "observed" else np.zeros(3)
            self._lay_floor(name, layout, shift)
            self._clouds[name] = self._empty_cloud(name, layout, shift, extent)

    def aim(self, from_above: bool) -> None:
        """Turn the camera so that both grids are in view."""
        if self.layout is None:
            return
        camera = self.client.camera
        aspect = camera.image_width / max(camera.image_height, 1)
        pose = camera_pose(self.layout, aspect, _FOV, from_above)
        camera.fov = _FOV
        camera.up_direction = np.array([0.0, 0.0, 1.0])
        camera.position = pose.position
        camera.look_at = pose.look_at

    def show(self, picture: Picture) -> None:
        """Draw both grids; only what changed is sent."""
        self._fill(self._clouds["predicted"], picture.predicted)
        self._fill(self._clouds["observed"], picture.observed)

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
        half = np.full(3, self.layout.grid.resolution_m * 0.6)
        centre = self.layout.grid.centre_at(index)
        for name in _GRIDS:
            shift = self.layout.shift if name == "observed" else np.zeros(3)
            self._frame(f"/{name}/selected", centre + shift, half)

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

    def _fill(self, handle: viser.PointCloudHandle, cloud: Cloud) -> None:
        handle.visible = len(cloud.row) > 0
        if handle.visible:
            handle.points = cloud.index.astype(np.float32) + np.float32(0.5)
            handle.colors = cloud.color

    def _empty_cloud(
        self, name: str, layout: Layout, shift: NDArray[np.float64], extent: int
    ) -> viser.PointCloudHandle:
        return self.client.scene.add_point_cloud(
            f"/{name}/cells",
            points=np.zeros((1, 3), dtype=np.float32),
            colors=np.zeros((1, 3), dtype=np.uint8),
            point_size=CELL_HALF,
            point_shape="square",
            point_shading="flat",
            precision="float16" if extent < _EXACT_FLOAT16 / 2 else "float32",
            scale=layout.grid.resolution_m,
            position=np.asarray(layout.grid.origin) + shift,
            visible=False,
        )

    def _lay_floor(self, name: str, layout: Layout, shift: NDArray[np.float64]) -> None:
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
        self._frame(f"/{name}/outline", np.array([centre[0], centre[1], bottom]), edge, colors.FLOOR)
        self.client.scene.add_label(
            f"/{name}/label",
            name.capitalize(),
            position=(centre[0], layout.high[1], layout.high[2]),
            anchor="bottom-center",
            font_screen_scale=1.3,
        )

    def _frame(
        self, name: str, centre: NDArray[np.float64], half: NDArray[np.float64], color: colors.Rgb = colors.SELECTED
    ) -> None:
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
        corners = centre + signs * half
        self.client.scene.add_line_segments(
            name, corners[_EDGES], np.array(color, dtype=np.uint8), thickness=2.5, thickness_units="screen"
        )

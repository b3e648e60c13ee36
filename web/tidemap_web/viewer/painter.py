"""Paints what a tab wants to see and reports it to its page. Used by one thread, the session's."""

import logging
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from tidemap.services.locations import LocationSummary
from tidemap.space.grid import Extent, GridGeometry
from tidemap_web.viewer import report
from tidemap_web.viewer.cells import Cloud, Ground, Taste, picture
from tidemap_web.viewer.layout import Layout, arrange
from tidemap_web.viewer.messages import Aim, PageMessage, Select, ViewRequest
from tidemap_web.viewer.painted import PaintedView
from tidemap_web.viewer.picking import Ray, first_hit
from tidemap_web.viewer.scene import CELL_HALF, Scene
from tidemap_web.viewer.source import Question, Source, ViewedState

_log = logging.getLogger(__name__)
ACKNOWLEDGE_S = 15.0
FRESH_S = 3600.0
Key = tuple[str, float, int, int]
"""Identifies the cells of a location at a revision: its name, when it was made, revision, number of cells."""


class Painter:
    """Keeps what is on the screen, so that only differences are sent."""

    def __init__(self, source: Source, publish: Callable[[PageMessage], None]) -> None:
        self.shown: PaintedView | None = None
        self.updates = 0
        self._source = source
        self._publish = publish
        self._scene: Scene | None = None
        self._built: str | None = None
        self._aim: Aim | None = None
        self._selected: int | None = None
        self._location: str | None = None
        self._known: set[str] = set()
        self._laid: tuple[Key, Ground, Layout] | None = None
        self._means: tuple[Key, NDArray[np.float32]] | None = None

    def prepare(self, scene: Scene | None, aim: Aim | None, select: Select | None) -> None:
        """Take what came with the request; None changes nothing."""
        if scene is not None:
            self._scene, self._built = scene, None
        if aim is not None:
            self._aim = aim
        if select is not None:
            self._selected = select.cell

    def concerned(self, names: set[str]) -> bool:
        """Whether news of these locations can change what the tab shows; asked from other threads."""
        return self.shown is None or self._location in names or not names <= self._known

    def paint(self, request: ViewRequest, news: bool) -> None:
        """Bring the tab to a request; `news` asks for everything afresh.

        Raises LocationNotFoundError.
        """
        if news:
            self._publish_grids()
        name = request.location or next((grid.name for grid in self._source.grids()), None)
        if name is None:
            self.blank("no-grids", "")
            return
        location = self._source.grid(name)
        if news or self._location != name:
            self._publish_location(location)
        shown = self._painted(location, request)
        if shown is None:
            self.blank("no-observations", name)
            return
        self._draw(shown)
        self.shown = shown
        self._publish(report.frame(shown, request, self._selected))

    def blank(self, reason: str, detail: str) -> None:
        """Show nothing, and say why."""
        if self._scene is not None:
            with self._scene.client.atomic():
                self._scene.clear()
            self._scene.client.flush()
        self._built = None
        self.shown = None
        self._publish(report.notice(reason, detail))

    def pick(self, ray: Ray) -> int | None:
        """The linear index of the first cell under a ray; asked from other threads."""
        shown = self.shown
        if shown is None:
            return None
        clouds = ((shown.picture.predicted, np.zeros(3)), (shown.picture.observed, shown.layout.shift))
        hits = [_hit(shown, cloud, ray.moved(shift)) for cloud, shift in clouds]
        return min((hit for hit in hits if hit is not None), default=(0.0, None))[1]

    def _publish_grids(self) -> None:
        grids = self._source.grids()
        self._known |= {grid.name for grid in grids}
        self._publish(report.grids(grids))

    def _publish_location(self, location: LocationSummary) -> None:
        if self._location != location.name:
            self._selected = None
        self._location = location.name
        now = self._source.now()
        first = location.first_time if location.first_time is not None else now
        marks = self._source.events(location.name, first)
        self._publish(report.location(location, marks, now, self._source.first_update()))

    def _painted(self, location: LocationSummary, request: ViewRequest) -> PaintedView | None:
        """What there is to see; None when nothing has been observed."""
        if location.last_time is None or location.grid is None:
            return None
        time = location.last_time if request.live or request.time is None else request.time
        state = self._source.state(Question(location.name, time, request.confidence, request.order))
        if len(state.cell) == 0 or state.shape != location.grid.shape:
            # Of another shape it is another location, which has just taken the name of this one.
            return None
        ground, layout = self._lay(location, location.grid, state)
        usual = self._usual(location, state) if request.dim and state.revision else None
        taste = Taste(request.floor, max(FRESH_S, 2 * location.interval_s))
        return PaintedView(location, state, picture(state, ground, usual, taste), layout, taste)

    def _lay(self, location: LocationSummary, grid: GridGeometry, state: ViewedState) -> tuple[Ground, Layout]:
        """Where the state's cells are, worked out once a revision; before the first one they change with the time."""
        key = _key(location, state)
        if self._laid is None or self._laid[0] != key or not state.revision:
            ground = Ground.of(grid, state.cell)
            layout = arrange(grid, ground.index, location.extent is Extent.PLANE)
            self._laid = (key, ground, layout)
        return self._laid[1], self._laid[2]

    def _usual(self, location: LocationSummary, state: ViewedState) -> NDArray[np.float32] | None:
        """Mean probabilities of the state's cells, asked for once a revision."""
        key = _key(location, state)
        if self._means is None or self._means[0] != key:
            mean = self._source.state(Question(location.name, state.time, None, 0, observed=False))
            self._means = (key, mean.probability)
        usual = self._means[1]
        return usual if len(usual) == len(state.cell) else None

    def _draw(self, shown: PaintedView) -> None:
        scene = self._scene
        if scene is None:
            return
        with scene.client.atomic():
            if self._built != shown.location.name or not shown.layout.same_as(scene.layout):
                scene.build(shown.layout, max(shown.grid.shape))
            if self._built != shown.location.name:
                scene.aim(from_above=shown.layout.flat)
            scene.show(shown.picture)
            scene.select(_index(shown, self._selected))
            if self._aim is not None:
                scene.aim(from_above=self._aim.view == "above")
        self._built, self._aim = shown.location.name, None
        self._send(scene)

    def _send(self, scene: Scene) -> None:
        """Wait for the browser, so that no more than one update is under way; not for one that sleeps or is gone."""
        try:
            scene.send(ACKNOWLEDGE_S)
            self.updates += 1
        except TimeoutError:
            _log.debug("a browser did not acknowledge an update in %g s", ACKNOWLEDGE_S)
        except ConnectionError:
            self._scene = None


def _key(location: LocationSummary, state: ViewedState) -> Key:
    return location.name, location.created_at, state.revision, len(state.cell)


def _index(shown: PaintedView, cell: int | None) -> NDArray[np.int64] | None:
    if cell is None or cell >= shown.grid.n_cells:
        return None
    index: NDArray[np.int64] = shown.grid.index([cell])[0]
    return index


def _hit(shown: PaintedView, cloud: Cloud, ray: Ray) -> tuple[float, int] | None:
    """Depth and linear index of the first cell of a cloud under a ray."""
    hit = first_hit(ray, shown.grid.centre_at(cloud.index), CELL_HALF * shown.grid.resolution_m)
    return None if hit is None else (hit[0], int(shown.state.cell[cloud.row[hit[1]]]))

"""Paints what a tab wants to see and reports it to its page. Used by one thread, the session's."""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tidemap.services.anomalies import Anomaly
from tidemap.services.context import Loaded, Seen
from tidemap.services.locations import LocationSummary
from tidemap.services.map_view import MapQuery, MapView, day_of
from tidemap.space.grid import Extent, GridGeometry
from tidemap_web.viewer import report
from tidemap_web.viewer.asked import taste_of
from tidemap_web.viewer.board import NO_SWING, WHOLE, Board, Taste
from tidemap_web.viewer.events import boxes
from tidemap_web.viewer.hits import NO_HIT, Hit, hit_of
from tidemap_web.viewer.layout import Layout, arrange
from tidemap_web.viewer.messages import Aim, PageMessage, Select, ViewRequest
from tidemap_web.viewer.news import Fresh
from tidemap_web.viewer.painted import PaintedView
from tidemap_web.viewer.painting import BY_DAY
from tidemap_web.viewer.picking import Ray
from tidemap_web.viewer.scene import Scene
from tidemap_web.viewer.source import Source
from tidemap_web.viewer.surroundings import Marker, Surroundings

_log = logging.getLogger(__name__)
ACKNOWLEDGE_S: Final = 15.0
BELIEVED_S: Final = 2.0
"""How long a location is taken to be as it was; what this process changes is noticed at once."""
TITLES: Final = {
    "beside": ("Predicted", "Observed"),
    "overlay": ("Predicted, with what was seen otherwise",),
    "difference": ("Observed less predicted",),
}
ALL_KINDS: Final = frozenset({"observation", "anomaly", "update", "location"})
"""News that change what a tab shows."""


@dataclass(frozen=True, slots=True, eq=False)
class _Loaded:
    """What was last seen when a question was asked, for maps whose film is too large to be kept."""

    location: str
    time: float
    seen: Seen | None


@dataclass(frozen=True, slots=True, eq=False)
class _Day:
    """p's amplitude (n_cells,) over the day from `start`, by a model."""

    loaded: Loaded
    start: float
    amplitude: NDArray[np.float32]


class Painter:
    """Keeps what is on the screen, so that only differences are sent.

    `want` is asked to load what was last seen where a view has it not at hand; None: nothing any more.
    """

    def __init__(
        self, source: Source, publish: Callable[[PageMessage], None], want: Callable[[MapQuery | None], None]
    ) -> None:
        self.shown: PaintedView | None = None
        self.updates = 0
        self._source = source
        self._publish = publish
        self._want = want
        self._scene: Scene | None = None
        self._drawn: Board | None = None
        self._built: str | None = None
        self._aim: Aim | None = None
        self._selected: int | None = None
        self._location: str | None = None
        self._known: set[str] = set()
        self._board: Board | None = None
        self._layout: Layout | None = None
        self._events: list[Anomaly] = []
        self._loaded: _Loaded | None = None
        self._asked_at = 0.0
        self._order: int | None = None
        self._around = Surroundings(source)
        self._listed: tuple[Marker, ...] | None = None
        self._day: _Day | None = None

    def prepare(self, scene: Scene | None, aim: Aim | None, select: Select | None) -> None:
        """Take what came with the request; None changes nothing."""
        if scene is not None:
            self._scene, self._built, self._drawn = scene, None, None
        if aim is not None:
            self._aim = aim
        if select is not None:
            self._selected = select.cell

    def loaded(self, query: MapQuery, seen: Seen | None) -> None:
        """What was wanted is at hand, or cannot be had."""
        self._loaded = _Loaded(query.location, query.time, seen)

    def concerned(self, fresh: Fresh) -> bool:
        """Whether news can change what the tab shows; asked from other threads."""
        if any("location" in kinds for kinds in fresh.values()):
            return True
        if fresh.keys() & self._around.names:
            return True
        return bool(fresh.get(self._location or "", frozenset()) & ALL_KINDS)

    def has_listed(self, name: str) -> bool:
        """Whether there was a grid of this name since the tab opened."""
        return name in self._known

    def paint(self, request: ViewRequest, fresh: Fresh | None) -> None:
        """Bring the tab to a request; `fresh` says what is new, None that nothing is known yet.

        Raises LocationNotFoundError.
        """
        if fresh is None or any("location" in kinds for kinds in fresh.values()):
            self._publish_grids()
        name = request.location or next((grid.name for grid in self._source.grids()), None)
        if name is None:
            self.blank("no-grids", "")
            return
        location, like = self._found(name, request, fresh)
        self._publish_location(location, ALL_KINDS if fresh is None else fresh.get(name, frozenset()))
        self._around.refresh(location, fresh)
        shown = self._painted(location, request, like)
        if shown is None:
            self.blank("no-observations", name)
            return
        self._draw(shown)
        self.shown = shown
        self._publish_markers(shown.around.markers)
        self._publish(report.frame(shown, request, self._selected, drawn=self._scene is not None))

    def blank(self, reason: str, detail: str) -> None:
        """Show nothing, and say why."""
        self._want(None)
        if self._scene is not None:
            with self._scene.client.atomic():
                self._scene.clear()
            self._scene.client.flush()
        self._built = self._drawn = None
        self.shown = None
        self._publish(report.notice(reason, detail))

    def pick(self, ray: Ray) -> Hit:
        """What is under a ray; asked from other threads."""
        return NO_HIT if self.shown is None else hit_of(self.shown, ray)

    def hovered(self, at: tuple[float, float]) -> PageMessage:
        """What is under the pointer, at shares of the scene's width and height."""
        shown = self.shown
        if shown is None or self._scene is None:
            return report.hovered(at, None, None)
        hit = hit_of(shown, self._scene.ray(at))
        return report.hovered(at, None if hit.cell is None else report.cell(shown, hit.cell), hit.marker)

    def _found(self, name: str, request: ViewRequest, fresh: Fresh | None) -> tuple[LocationSummary, MapView | None]:
        """The location, and the view before where another moment of the same is asked for: no question is needed."""
        before, now = self.shown, monotonic()
        known = before is not None and before.location.name == name and now - self._asked_at < BELIEVED_S
        if before is not None and known and fresh is not None and name not in fresh:
            same = request.order == self._order
            self._order = request.order
            return before.location, before.view if same else None
        self._asked_at, self._order = now, request.order
        return self._source.grid(name), None

    def _publish_grids(self) -> None:
        grids = self._source.grids()
        self._known |= {grid.name for grid in grids}
        self._publish(report.grids(grids))

    def _publish_location(self, location: LocationSummary, kinds: frozenset[str]) -> None:
        other = self._location != location.name
        self._location = location.name
        now = self._source.now()
        if other or kinds & {"anomaly", "location"}:
            first = location.first_time if location.first_time is not None else now
            self._events = self._source.events(location.name, first)
            self._publish(report.events(self._events))
        if other or kinds & ALL_KINDS:
            self._publish(report.location(location, now, self._source.first_update()))

    def _publish_markers(self, markers: tuple[Marker, ...]) -> None:
        if markers != self._listed:
            self._listed = markers
            self._publish(report.markers(markers))

    def _painted(self, location: LocationSummary, request: ViewRequest, like: MapView | None) -> PaintedView | None:
        """What there is to see; None when nothing has been observed."""
        if location.last_time is None or location.grid is None:
            return None
        time = location.last_time if request.live or request.time is None else request.time
        query = MapQuery(location.name, time, request.confidence, request.order)
        view = self._source.view(query, like)
        if not view.loaded.known.size or view.location.cells.shape != location.grid.shape:
            # Of another shape it is another location, which has just taken the name of this one.
            return None
        board, layout = self._lay(location, location.grid, view, request)
        seen = self._seen(query, view)
        taste = taste_of(request, location)
        picture = board.paint(view, seen, taste, self._swing(view, taste))
        around = self._around.at(location, view.time, request.confidence, overlaid=not layout.beside)
        return PaintedView(location, view, seen, board, picture, layout, taste, around)

    def _swing(self, view: MapView, taste: Taste) -> NDArray[np.float32]:
        """p's amplitude over the day, where a layer shows it: worked out once a day and revision."""
        if taste.layers()[0].source != BY_DAY:
            return NO_SWING
        day = self._day
        if day is None or day.loaded is not view.loaded or day.start != day_of(view):
            self._day = day = _Day(view.loaded, day_of(view), self._source.day_amplitude(view))
        return day.amplitude

    def _seen(self, query: MapQuery, view: MapView) -> Seen | None:
        """What was last seen, at hand or to be loaded."""
        loaded = self._loaded
        if view.seen is not None:
            self._want(None)
            return view.seen
        if loaded is not None and (loaded.location, loaded.time) == (query.location, query.time):
            return loaded.seen
        self._want(query)
        before = self.shown
        if before is not None and before.location.id == view.location.id and before.view.time == view.time:
            return before.seen  # what was known a moment ago
        return None

    def _lay(
        self, location: LocationSummary, grid: GridGeometry, view: MapView, request: ViewRequest
    ) -> tuple[Board, Layout]:
        """Where the cells are: worked out once a revision, for many times."""
        board, layout, titles = self._board, self._layout, TITLES[request.layout]
        if board is None or board.loaded is not view.loaded or board.grid != grid:
            board, layout = Board(grid, view), None
        if layout is None or layout.titles != titles:
            layout = arrange(board.bounds, location.extent is Extent.PLANE, titles)
        self._board, self._layout = board, layout
        return board, layout

    def _draw(self, shown: PaintedView) -> None:
        scene = self._scene
        if scene is None:
            return
        with scene.client.atomic():
            if self._built != shown.location.name or not shown.layout.same_as(scene.layout):
                scene.build(shown.layout)
                self._drawn = None
            if self._built != shown.location.name:
                scene.aim(from_above=shown.layout.flat)
            if self._drawn is shown.board:
                scene.show(shown.board, shown.picture)
            else:
                scene.show_all(shown.board)
            scene.outline(boxes(self._events, shown))
            scene.crop(_box(shown))
            scene.surround(shown.around)
            scene.select(_index(shown, self._selected))
            if self._aim is not None and self._aim.view == "pose":
                scene.put_camera(self._aim.pose)
            elif self._aim is not None:
                scene.aim(from_above=self._aim.view == "above")
        self._built, self._drawn, self._aim = shown.location.name, shown.board, None
        self._send(scene)

    def _send(self, scene: Scene) -> None:
        """Wait for the browser, so that no more than one update is under way; not for one that sleeps or is gone."""
        try:
            scene.send(ACKNOWLEDGE_S)
            self.updates += 1
        except TimeoutError:
            _log.debug("a browser did not acknowledge an update in %g s", ACKNOWLEDGE_S)
        except ConnectionError:
            self._scene = self._drawn = None


def _index(shown: PaintedView, cell: int | None) -> NDArray[np.int64] | None:
    if cell is None or cell >= shown.grid.n_cells:
        return None
    index: NDArray[np.int64] = shown.grid.index([cell])[0]
    return index


def _box(shown: PaintedView) -> tuple[float, ...] | None:
    """What is cropped to, in metres; None where nothing is cut away."""
    if shown.taste.crop == WHOLE:
        return None
    low, high = np.array(shown.taste.crop[:3]), np.array(shown.taste.crop[3:])
    last = np.array(shown.grid.shape3) - 1
    if not low.any() and (high >= last).all():
        return None
    return shown.grid.box_at(np.stack([np.minimum(low, last), np.minimum(high, last)]))

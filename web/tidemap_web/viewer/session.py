"""One browser tab: its newest request, and the thread that has it painted."""

import logging
import threading
from collections.abc import Callable

from tidemap.errors import DomainError, LocationNotFoundError
from tidemap.services.context import Seen
from tidemap.services.map_view import MapQuery
from tidemap_web.viewer import report
from tidemap_web.viewer.loading import Loader
from tidemap_web.viewer.messages import Aim, Asked, Hover, PageMessage, Select, ViewRequest
from tidemap_web.viewer.news import Fresh, together
from tidemap_web.viewer.painter import Painter
from tidemap_web.viewer.picking import Ray
from tidemap_web.viewer.scene import Scene
from tidemap_web.viewer.source import Source

_log = logging.getLogger(__name__)

OBSERVED = "what was last seen"
"""What takes long to load."""


class Session:
    """The newest request wins; at most one update is on its way to the browser.

    `publish` takes messages for the page and returns at once. All public methods return at once; painting
    happens on the session's own thread.
    """

    def __init__(self, token: str, source: Source, publish: Callable[[PageMessage], None]) -> None:
        self.token = token
        self._publish = publish
        self._source = source
        self._loader = Loader(source, self._loading, self._take_loaded)
        self._painter = Painter(source, publish, self._loader.want)
        self._changed = threading.Condition()
        self._request = ViewRequest()
        self._aim: Aim | None = None
        self._select: Select | None = None
        self._hover: Hover | None = None
        self._arrived: Scene | None = None
        self._fresh: Fresh | None = None
        self._arrivals: tuple[MapQuery, Seen | None] | None = None
        self._pending = False
        self._busy = False
        self._closed = False
        self._worker = threading.Thread(target=self._work, name=f"viewer-{token[:6]}", daemon=True)

    def start(self) -> None:
        """Begin to work."""
        self._worker.start()

    def ask(self, request: Asked) -> None:
        """Take a message of the page."""
        with self._changed:
            if isinstance(request, Hover):
                self._hover = request
                self._changed.notify_all()
                return
            if isinstance(request, ViewRequest):
                self._request = request
            elif isinstance(request, Aim):
                self._aim = request
            else:
                self._select = request
            self._wake()

    def attach(self, scene: Scene) -> None:
        """A browser has opened, or reopened, the scene."""
        with self._changed:
            self._arrived = scene
            self._wake()

    def notify(self, fresh: Fresh) -> None:
        """Something new is known at some locations."""
        with self._changed:
            if self._painter.concerned(fresh):
                self._fresh = None if self._fresh is None else together(self._fresh, fresh)
                self._wake()

    def pick(self, ray: Ray) -> None:
        """Select what is under a ray: a cell or none; a marker, which leaves the cell as it was."""
        if self._painter.shown is None:
            return
        hit = self._painter.pick(ray)
        if hit.marker is None:
            self.ask(Select(kind="select", cell=hit.cell))
        name = None if hit.marker is None else hit.marker.name
        self._publish({"kind": "picked", "cell": hit.cell, "marker": name})

    def camera_moved(self, pose: list[float] | None) -> None:
        """The camera is there now; None: at a standard view."""
        self._publish({"kind": "camera", "pose": pose})

    def close(self) -> None:
        """Stop working; what is being painted is finished or given up."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        self._loader.want(None)

    def stats(self) -> PageMessage:
        """Facts for tests and operators."""
        with self._changed:
            idle = not (self._pending or self._busy)
            return report.stats(self.token, self._painter.shown, self._painter.updates, idle)

    def _loading(self, share: float) -> None:
        self._publish(report.progress(OBSERVED, share))

    def _take_loaded(self, query: MapQuery, seen: Seen | None) -> None:
        self._publish(report.progress(OBSERVED, None))
        with self._changed:
            self._arrivals = (query, seen)
            self._wake()

    def _wake(self) -> None:
        self._pending = True
        self._changed.notify_all()

    def _work(self) -> None:
        while self._await():
            with self._changed:
                painting, self._pending = self._pending, False
                hover, self._hover = self._hover, None
            if painting:
                self._paint(*self._take())
            if hover is not None:
                self._point(hover)

    def _point(self, hover: Hover) -> None:
        try:
            self._publish(self._painter.hovered((hover.at[0], hover.at[1])))
        except Exception:
            _log.exception("viewer session %s could not say what is under the pointer", self.token[:6])

    def _await(self) -> bool:
        """Wait for something to do; False when there will be nothing more."""
        with self._changed:
            self._busy = False
            self._changed.wait_for(lambda: self._pending or self._hover is not None or self._closed)
            self._busy = not self._closed
            return self._busy

    def _take(self) -> tuple[ViewRequest, Fresh | None]:
        """Hand what has changed to the painter; the request, and what is new."""
        with self._changed:
            scene, self._arrived = self._arrived, None
            aim, self._aim = self._aim, None
            select, self._select = self._select, None
            loaded, self._arrivals = self._arrivals, None
            fresh, self._fresh = self._fresh, {}
            request = self._request
        self._painter.prepare(scene, aim, select)
        if loaded is not None:
            self._painter.loaded(*loaded)
        return request, fresh

    def _paint(self, request: ViewRequest, fresh: Fresh | None) -> None:
        try:
            self._painter.paint(request, fresh)
        except LocationNotFoundError as error:
            self._painter.blank(self._reason(request), str(error))
        except DomainError as error:
            self._painter.blank("error", str(error))
        except Exception:
            _log.exception("viewer session %s failed", self.token[:6])
            self._painter.blank("error", "The viewer failed; the server's log says why.")

    def _reason(self, request: ViewRequest) -> str:
        """Why there is no such grid: it is a location of another kind, or was listed before, or never was."""
        name = request.location or ""
        if self._source.is_location(name):
            return "no-grid"
        return "deleted" if self._painter.has_listed(name) else "not-found"

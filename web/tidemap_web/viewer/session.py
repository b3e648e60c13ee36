"""One browser tab: its newest request, and the thread that has it painted."""

import logging
import threading
from collections.abc import Callable

from tidemap.errors import DomainError, LocationNotFoundError
from tidemap_web.viewer import report
from tidemap_web.viewer.messages import Aim, PageMessage, Select, ViewRequest
from tidemap_web.viewer.painter import Painter
from tidemap_web.viewer.picking import Ray
from tidemap_web.viewer.scene import Scene
from tidemap_web.viewer.source import Source

_log = logging.getLogger(__name__)


class Session:
    """The newest request wins; at most one update is on its way to the browser.

    `publish` takes messages for the page and returns at once. All public methods return at once; painting
    happens on the session's own thread.
    """

    def __init__(self, token: str, source: Source, publish: Callable[[PageMessage], None]) -> None:
        self.token = token
        self._painter = Painter(source, publish)
        self._changed = threading.Condition()
        self._request = ViewRequest()
        self._aim: Aim | None = None
        self._select: Select | None = None
        self._arrived: Scene | None = None
        self._news = True
        self._pending = False
        self._busy = False
        self._closed = False
        self._worker = threading.Thread(target=self._work, name=f"viewer-{token[:6]}", daemon=True)

    def start(self) -> None:
        """Begin to work."""
        self._worker.start()

    def ask(self, request: ViewRequest | Aim | Select) -> None:
        """Take a message of the page."""
        with self._changed:
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

    def notify(self, names: set[str]) -> None:
        """Something new is known at these locations."""
        with self._changed:
            if self._painter.concerned(names):
                self._news = True
                self._wake()

    def pick(self, ray: Ray) -> None:
        """Select the first cell under a ray; none where there is none."""
        if self._painter.shown is not None:
            self.ask(Select(kind="select", cell=self._painter.pick(ray)))

    def close(self) -> None:
        """Stop working; what is being painted is finished or given up."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def stats(self) -> PageMessage:
        """Facts for tests and operators."""
        with self._changed:
            idle = not (self._pending or self._busy)
            return report.stats(self.token, self._painter.shown, self._painter.updates, idle)

    def _wake(self) -> None:
        self._pending = True
        self._changed.notify_all()

    def _work(self) -> None:
        while self._await():
            self._paint(*self._take())

    def _await(self) -> bool:
        """Wait for something to do; False when there will be nothing more."""
        with self._changed:
            self._busy = False
            self._changed.wait_for(lambda: self._pending or self._closed)
            self._busy, self._pending = not self._closed, False
            return not self._closed

    def _take(self) -> tuple[ViewRequest, bool]:
        """Hand what has changed to the painter; the request, and whether there are news."""
        with self._changed:
            scene, self._arrived = self._arrived, None
            aim, self._aim = self._aim, None
            select, self._select = self._select, None
            news, self._news = self._news, False
            request = self._request
        self._painter.prepare(scene, aim, select)
        return request, news

    def _paint(self, request: ViewRequest, news: bool) -> None:
        try:
            self._painter.paint(request, news)
        except LocationNotFoundError as error:
            self._painter.blank("not-found", str(error))
        except DomainError as error:
            self._painter.blank("error", str(error))
        except Exception:
            _log.exception("viewer session %s failed", self.token[:6])
            self._painter.blank("error", "The viewer failed; the server's log says why.")

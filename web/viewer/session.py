"""One browser tab: its wish, its scene and the worker that turns the one into the other."""

import logging
import math
import threading
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.errors import LocationNotFoundError, NoModelError, TidemapError
from app.schemas.locations import Location
from web.viewer import layout, report
from web.viewer.cells import Picture, index_of, picture
from web.viewer.messages import Aim, Message, Select, Wish
from web.viewer.picking import first_hit, rows_by_index
from web.viewer.scene import Scene
from web.viewer.source import Question, Source, State

_log = logging.getLogger(__name__)
_ACKNOWLEDGE_S = 15.0
_FRESH_S = 3600.0


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """What the tab shows now."""

    place: Location
    state: State
    picture: Picture

    @property
    def place_cells(self) -> int:
        """How many cells the location has."""
        return math.prod(self.state.shape)


class Session:
    """The newest wish wins; at most one update is on its way to the browser.

    `publish` takes messages for the page and returns at once. All public methods return at once; drawing happens
    on the session's own thread.
    """

    def __init__(self, token: str, source: Source, publish: Callable[[Message], None]) -> None:
        self.token = token
        self._source = source
        self._publish = publish
        self._changed = threading.Condition()
        self._wish = Wish()
        self._aim: str | None = None
        self._selected: int | None = None
        self._arrived: Scene | None = None
        self._scene: Scene | None = None
        self._shown: Shown | None = None
        self._built: tuple[str, bytes] | None = None
        self._place: str | None = None
        self._pending = False
        self._known: set[str] = set()
        self._stale = True
        self._busy = False
        self._closed = False
        self._updates = 0
        self._worker = threading.Thread(target=self._work, name=f"viewer-{token[:6]}", daemon=True)

    def start(self) -> None:
        """Begin to work."""
        self._worker.start()

    def ask(self, request: Wish | Aim | Select) -> None:
        """Take a message of the page."""
        with self._changed:
            if isinstance(request, Wish):
                self._wish = request
            elif isinstance(request, Aim):
                self._aim = request.view
            else:
                self._selected = request.cell
            self._wake()

    def attach(self, scene: Scene) -> None:
        """A browser has opened (or reopened) the scene."""
        with self._changed:
            self._arrived = scene
            self._wake()

    def notify(self, names: set[str]) -> None:
        """Something new is known at these locations."""
        with self._changed:
            if self._shown is None or self._place in names or not names <= self._known:
                self._stale = True
                self._wake()

    def pick(self, origin: tuple[float, float, float], direction: tuple[float, float, float]) -> None:
        """Select the first cell along a ray, both (3,) in metres of the scene; nothing where there is none."""
        shown, scene = self._shown, self._scene
        if shown is None or scene is None or scene.layout is None:
            return
        cell = _pick(shown, scene.layout, np.asarray(origin), np.asarray(direction))
        self.ask(Select(kind="select", cell=cell))

    def close(self) -> None:
        """Stop working; a drawing under way is finished or given up."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def stats(self) -> Message:
        """Facts for tests and operators."""
        with self._changed:
            return report.stats(
                self.token,
                self._shown,
                updates=self._updates,
                attached=self._scene is not None,
                idle=not (self._pending or self._busy),
            )

    def _wake(self) -> None:
        self._pending = True
        self._changed.notify_all()

    def _work(self) -> None:
        while True:
            with self._changed:
                self._busy = False
                self._changed.wait_for(lambda: self._pending or self._closed)
                if self._closed:
                    return
                self._busy, self._pending = True, False
                wish, scene, self._arrived = self._wish, self._arrived, None
                stale, self._stale = self._stale, False
            if scene is not None:
                self._scene, self._built = scene, None
            self._step(wish, stale)

    def _step(self, wish: Wish, stale: bool) -> None:
        try:
            if stale:
                self._tell_grids()
            self._show(wish, stale)
        except NoModelError as error:
            self._blank("no-model", str(error))
        except LocationNotFoundError as error:
            self._blank("not-found", str(error))
        except TidemapError as error:
            self._blank("error", str(error))
        except (RuntimeError, TimeoutError) as error:
            # The tab has gone or sleeps; its next connection draws anew.
            _log.debug("viewer session %s: %s", self.token[:6], error)
            self._built = None
        except Exception:
            _log.exception("viewer session %s failed", self.token[:6])
            self._blank("error", "The viewer failed; the server's log says why.")

    def _show(self, wish: Wish, stale: bool) -> None:
        name = wish.location or next((grid.name for grid in self._source.grids()), None)
        if name is None:
            self._blank("no-grids", "")
            return
        place = self._source.grid(name)
        self._tell_place(place, stale)
        if place.last_time is None or place.grid is None:
            self._blank("no-observations", name)
            return
        time = place.last_time if wish.follow or wish.time is None else wish.time
        state = self._source.state(Question(name, time, wish.confidence, wish.order))
        fresh_s = max(_FRESH_S, 2 * place.interval_s)
        shown = Shown(place, state, picture(state, wish.floor, fresh_s))
        self._draw(shown)
        self._shown = shown
        self._publish(report.frame(shown, wish, fresh_s, self._selected))

    def _tell_grids(self) -> None:
        grids = self._source.grids()
        self._known |= {grid.name for grid in grids}
        self._publish(report.grids(grids))

    def _tell_place(self, place: Location, stale: bool) -> None:
        if not stale and self._place == place.name:
            return
        if self._place != place.name:
            self._selected = None
        self._place = place.name
        first = place.first_time if place.first_time is not None else self._source.now()
        self._publish(report.place(place, self._source.events(place.name, first), self._source.now()))

    def _draw(self, shown: Shown) -> None:
        scene = self._scene
        if scene is None:
            return
        with scene.client.atomic():
            self._prepare(scene, shown)
            scene.show(shown.picture)
            scene.select(self._index(shown))
            self._turn(scene)
        scene.send(_ACKNOWLEDGE_S)
        self._updates += 1

    def _prepare(self, scene: Scene, shown: Shown) -> None:
        """Rebuild floor and clouds when the location, or the part of it that has been seen, is another."""
        grid = shown.place.grid
        if grid is None or len(shown.state.cell) == 0:
            return
        index = index_of(shown.state.cell, shown.state.shape)
        key = (shown.place.name, np.concatenate([index.min(axis=0), index.max(axis=0)]).tobytes())
        if key == self._built:
            return
        arranged = layout.arrange(grid.origin, grid.resolution_m, index, shown.place.kind == "grid2d")
        scene.build(arranged, max(shown.state.shape), aim=self._built is None or self._built[0] != shown.place.name)
        self._built = key

    def _turn(self, scene: Scene) -> None:
        with self._changed:
            view, self._aim = self._aim, None
        if view is not None:
            scene.aim(from_above=view == "above")

    def _index(self, shown: Shown) -> NDArray[np.int32] | None:
        if self._selected is None or self._selected >= shown.place_cells:
            return None
        index: NDArray[np.int32] = index_of(np.array([self._selected], dtype=np.int64), shown.state.shape)[0]
        return index

    def _blank(self, reason: str, detail: str) -> None:
        if self._scene is not None:
            with self._scene.client.atomic():
                self._scene.clear()
            self._scene.client.flush()
        self._built = None
        self._shown = None
        self._publish(report.notice(reason, detail))


def _pick(shown: Shown, where: layout.Layout, origin: layout.Vector, direction: layout.Vector) -> int | None:
    """The linear index of the nearest drawn cell along a ray through both grids."""
    size = np.array((*shown.state.shape, 1, 1)[:3])
    best: tuple[float, int] | None = None
    for cloud, shift in ((shown.picture.predicted, np.zeros(3)), (shown.picture.observed, where.shift)):
        start = (origin - shift - where.origin) / where.resolution_m
        drawn = rows_by_index(cloud.index)
        hit = first_hit(start, direction, drawn, (int(size[0]), int(size[1]), int(size[2])))
        if hit is not None:
            distance = float(np.linalg.norm(np.array(hit) + 0.5 - start))
            cell = int(shown.state.cell[cloud.row[drawn[hit]]])
            best = min(best, (distance, cell)) if best else (distance, cell)
    return best[1] if best else None

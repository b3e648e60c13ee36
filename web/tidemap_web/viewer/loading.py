"""Loading what was last seen of a large map: in a thread of its own, so that a tab goes on while it waits."""

import logging
import threading
from collections.abc import Callable

from tidemap.errors import DomainError
from tidemap.services.context import Seen
from tidemap.services.map_view import MapQuery
from tidemap_web.viewer.source import Source

_log = logging.getLogger(__name__)
REPORTS = 100
"""How often a load says how far it is, at most."""


class SupersededError(Exception):
    """Something else is wanted by now."""


class Loader:
    """Loads what the newest question needs, one thing at a time.

    `progress` hears the share that is done, `done` the question and what was seen; both in the loader's thread.
    """

    def __init__(
        self, source: Source, progress: Callable[[float], None], done: Callable[[MapQuery, Seen | None], None]
    ) -> None:
        self._source = source
        self._progress = progress
        self._done = done
        self._lock = threading.Lock()
        self._wanted: MapQuery | None = None
        self._running = False

    def want(self, query: MapQuery | None) -> None:
        """Load this instead of what is being loaded; None: nothing any more."""
        with self._lock:
            self._wanted = query
            start = query is not None and not self._running
            self._running |= start
        if start:
            threading.Thread(target=self._work, name="viewer-loader", daemon=True).start()

    def _work(self) -> None:
        while (query := self._take()) is not None:
            try:
                seen = self._source.load(query, self._watching(query))
            except SupersededError:
                continue
            except DomainError:
                seen = None  # the painter finds the same, and says so
            except Exception:
                _log.exception("what was last seen of %r could not be loaded", query.location)
                seen = None
            with self._lock:
                self._wanted = None
            self._done(query, seen)  # who waits for something else looks at it anew, and asks again

    def _take(self) -> MapQuery | None:
        with self._lock:
            self._running = self._wanted is not None
            return self._wanted

    def _watching(self, query: MapQuery) -> Callable[[float], None]:
        """Says how far it is; ends what nobody waits for any more."""
        window, checked, said = self._source.window(query), query, -1

        def watch(share: float) -> None:
            nonlocal checked, said
            wanted = self._wanted
            if wanted is not checked:
                if wanted is None or self._source.window(wanted) != window:
                    raise SupersededError
                checked = wanted
            if int(share * REPORTS) != said:
                said = int(share * REPORTS)
                self._progress(share)

        return watch

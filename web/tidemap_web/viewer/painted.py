"""What a tab shows: the grid at a time, and how that is drawn."""

from dataclasses import dataclass

import numpy as np

from tidemap.history.history import UNOBSERVED
from tidemap.services.context import Seen
from tidemap.services.locations import LocationSummary
from tidemap.services.map_view import MapView
from tidemap.space.grid import GridGeometry
from tidemap_web.viewer.board import Board, Picture, Taste
from tidemap_web.viewer.layout import Layout
from tidemap_web.viewer.surroundings import NOBODY, Around


@dataclass(frozen=True, slots=True, eq=False)
class PaintedView:
    """One grid. seen: what was last seen of it, None while that is loaded."""

    location: LocationSummary
    view: MapView
    seen: Seen | None
    board: Board
    picture: Picture
    layout: Layout
    taste: Taste
    around: Around = NOBODY

    @property
    def loading(self) -> bool:
        """Whether what was last seen is still to come."""
        return self.view.seen is None and self.seen is None

    @property
    def grid(self) -> GridGeometry:
        """Where its cells are."""
        return self.layout.grid

    def is_known(self, cell: int) -> bool:
        """Whether a cell has been observed."""
        known = self.view.loaded.known
        row = int(np.searchsorted(known, cell))
        return row < len(known) and int(known[row]) == cell

    def last_seen(self, cell: int) -> tuple[int, float] | None:
        """The state that a cell was last seen in, and when that sample began."""
        if self.seen is None or self.seen.state[cell] == UNOBSERVED:
            return None
        return int(self.seen.state[cell]), float(self.view.location.base.time(self.seen.sample[cell]))

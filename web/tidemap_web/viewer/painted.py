"""What a tab shows: the grid, its state at a time, and how that is drawn."""

from dataclasses import dataclass

from tidemap.services.locations import LocationSummary
from tidemap.space.grid import GridGeometry
from tidemap_web.viewer.cells import Picture, Taste
from tidemap_web.viewer.layout import Layout
from tidemap_web.viewer.source import ViewedState


@dataclass(frozen=True, slots=True, eq=False)
class PaintedView:
    """One grid, predicted and observed."""

    location: LocationSummary
    state: ViewedState
    picture: Picture
    layout: Layout
    taste: Taste

    @property
    def grid(self) -> GridGeometry:
        """Where its cells are."""
        return self.layout.grid

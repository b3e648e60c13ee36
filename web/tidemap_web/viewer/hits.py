"""What is under the pointer: a marker, or a cell."""

from dataclasses import dataclass
from typing import Final

from tidemap_web.viewer.painted import PaintedView
from tidemap_web.viewer.picking import Ray, cells_near, first_hit
from tidemap_web.viewer.scene import CELL_HALF
from tidemap_web.viewer.surroundings import Marker


@dataclass(frozen=True, slots=True)
class Hit:
    """The number of a cell, or a marker, or neither."""

    cell: int | None = None
    marker: Marker | None = None


NO_HIT: Final = Hit()


def hit_of(shown: PaintedView, ray: Ray) -> Hit:
    """The nearest under a ray; a marker also where it stands in cells."""
    rays = [(side, ray.moved(shown.layout.shift * side)) for side in range(1 + shown.layout.beside)]
    cells = [hit for side, moved in rays if (hit := _cell(shown, side, moved)) is not None]
    markers = [hit for _, moved in rays if (hit := _marker(shown, moved)) is not None]
    cell, marker = min(cells, default=None), min(markers, default=None)
    if marker is not None and (cell is None or marker[0] <= cell[0] + 2 * shown.layout.marker_m):
        return Hit(marker=shown.around.markers[marker[1]])
    return NO_HIT if cell is None else Hit(cell=cell[1])


def _cell(shown: PaintedView, side: int, ray: Ray) -> tuple[float, int] | None:
    """Depth and number of the first cell of a grid under a ray."""
    rows = shown.board.shown_of(side, cells_near(ray, shown.grid))
    hit = first_hit(ray, shown.grid.centre_at(shown.board.index[rows]), CELL_HALF * shown.grid.resolution_m)
    return None if hit is None else (hit[0], int(shown.board.cell[rows[hit[1]]]))


def _marker(shown: PaintedView, ray: Ray) -> tuple[float, int] | None:
    """Depth and number of the first marker of a grid under a ray."""
    return first_hit(ray, shown.around.positions, shown.layout.marker_m)

"""The floor plan: what never moves, where people sit, and the places of what does move. Boxes of cells."""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

SHAPE = (60, 40, 12)
RESOLUTION_M = 0.2
TOP = SHAPE[2]

Box: TypeAlias = tuple[slice, slice, slice]
Cells: TypeAlias = NDArray[np.bool_]


def box(x: tuple[int, int], y: tuple[int, int], z: tuple[int, int]) -> Box:
    """The cells from the first to the last of each axis, both included."""
    return slice(x[0], x[1] + 1), slice(y[0], y[1] + 1), slice(z[0], z[1] + 1)


WALL = (1, TOP - 1)
DOORWAY = (1, 9)
WINDOW = (5, 9)

WALLS = (
    box((0, 59), (0, 0), WALL),
    box((0, 59), (39, 39), WALL),
    box((0, 0), (0, 39), WALL),
    box((59, 59), (0, 39), WALL),
    box((0, 59), (16, 16), WALL),
    box((0, 59), (23, 23), WALL),
    box((34, 34), (0, 16), WALL),
    box((38, 38), (23, 39), WALL),
)
OPENINGS = (
    box((0, 0), (18, 22), DOORWAY),
    box((26, 30), (16, 16), DOORWAY),
    box((40, 44), (16, 16), DOORWAY),
    box((10, 14), (23, 23), DOORWAY),
    box((44, 48), (23, 23), DOORWAY),
    box((4, 10), (0, 0), WINDOW),
    box((15, 21), (0, 0), WINDOW),
    box((40, 54), (0, 0), WINDOW),
    box((5, 14), (39, 39), WINDOW),
    box((22, 31), (39, 39), WINDOW),
    box((43, 53), (39, 39), (6, 9)),
    box((59, 59), (18, 21), WINDOW),
)


def desk(x: int, y: int, wall: int) -> tuple[Box, ...]:
    """A desk of 7 x 4 cells, a panel at each end, a monitor on the side of the wall (0 low y, 1 high y)."""
    screen = y + 1 if wall == 0 else y + 2
    return (
        box((x, x + 6), (y, y + 3), (3, 3)),
        box((x, x), (y, y + 3), (1, 2)),
        box((x + 6, x + 6), (y, y + 3), (1, 2)),
        box((x + 2, x + 4), (screen, screen), (4, 6)),
    )


OFFICE = (
    *desk(3, 1, 0),
    *desk(14, 1, 0),
    *desk(3, 12, 1),
    *desk(14, 12, 1),
    box((32, 33), (2, 9), (1, 8)),
)
MEETING_ROOM = (
    box((41, 52), (6, 10), (3, 3)),
    box((43, 44), (7, 9), (1, 2)),
    box((49, 50), (7, 9), (1, 2)),
    box((58, 58), (4, 12), (4, 8)),
)
LAB = (
    box((3, 15), (35, 38), (4, 4)),
    box((3, 3), (35, 38), (1, 3)),
    box((15, 15), (35, 38), (1, 3)),
    box((8, 10), (37, 38), (5, 7)),
    box((20, 32), (35, 38), (4, 4)),
    box((20, 20), (35, 38), (1, 3)),
    box((32, 32), (35, 38), (1, 3)),
    box((28, 30), (36, 38), (5, 6)),
    box((15, 21), (27, 30), (1, 6)),
    box((16, 18), (28, 29), (7, 8)),
    box((1, 2), (25, 33), (1, 9)),
)
KITCHEN = (
    box((39, 54), (36, 38), (1, 4)),
    box((46, 48), (37, 37), (5, 6)),
    box((55, 58), (35, 38), (1, 8)),
    box((44, 49), (28, 31), (3, 3)),
    box((46, 47), (29, 30), (1, 2)),
    box((57, 58), (24, 29), (1, 3)),
)
FLOOR = box((0, 59), (0, 39), (0, 0))

ROOMS = (
    box((0, 34), (0, 16), (0, 11)),
    box((34, 59), (0, 16), (0, 11)),
    box((0, 59), (16, 23), (0, 11)),
    box((0, 38), (23, 39), (0, 11)),
    box((38, 59), (23, 39), (0, 11)),
)
"""With their walls: office, meeting room, corridor, lab, kitchen."""


@dataclass(frozen=True, slots=True)
class Door:
    """A leaf that is in the wall when closed and stands in the room when open."""

    closed: Box
    open: Box


MAIN_DOOR = Door(box((0, 0), (18, 22), DOORWAY), box((1, 5), (17, 17), DOORWAY))
OFFICE_DOOR = Door(box((26, 30), (16, 16), DOORWAY), box((30, 30), (11, 15), DOORWAY))


@dataclass(frozen=True, slots=True)
class Seat:
    """A chair of 2 x 2 cells at [x, y]; its back stands at `back`: -1 low y, 1 high y, 0 none (a stool)."""

    x: int
    y: int
    back: int

    def chair(self, shift: int = 0) -> tuple[Box, ...]:
        """The chair, shifted by cells along x."""
        x = (self.x + shift, self.x + shift + 1)
        if not self.back:
            return box(x, (self.y, self.y + 1), (2, 2)), box((x[0], x[0]), (self.y, self.y), (1, 1))
        seat = box(x, (self.y, self.y + 1), (1, 2))
        y = self.y if self.back < 0 else self.y + 1
        return seat, box(x, (y, y), (3, 4))

    def person(self) -> tuple[Box, ...]:
        """The chair in its place and somebody who sits on it: legs, body and head."""
        x = (self.x, self.x + 1)
        return *self.chair(), box(x, (self.y, self.y + 1), (1, 5)), box(x, (self.y, self.y), (6, 6))


OFFICE_SEATS = Seat(5, 5, 1), Seat(16, 5, 1), Seat(5, 10, -1), Seat(16, 10, -1)
LAB_SEATS = Seat(6, 33, 0), Seat(12, 33, 0), Seat(25, 33, 0)
MEETING_SEATS = (
    Seat(42, 4, -1),
    Seat(46, 4, -1),
    Seat(50, 4, -1),
    Seat(42, 11, 1),
    Seat(46, 11, 1),
    Seat(50, 11, 1),
)
KITCHEN_SEATS = Seat(42, 29, 0), Seat(50, 29, 0), Seat(46, 26, 0)
SEATS = (*OFFICE_SEATS, *LAB_SEATS, *MEETING_SEATS, *KITCHEN_SEATS)
WANDERING_SEATS = frozenset((KITCHEN_SEATS[2], LAB_SEATS[1]))
SHIFTS = (-1, 0, 1)
"""How far, in cells along x, chairs wander that people leave elsewhere."""


def plant(x: int, y: int) -> tuple[Box, ...]:
    """A slim plant at [x, y] with leaves around its top."""
    return (
        box((x, x), (y, y), (1, 5)),
        box((x - 1, x + 1), (y, y), (4, 4)),
        box((x, x), (y - 1, y + 1), (4, 4)),
    )


PLANT_FIRST = plant(29, 2)
PLANT_LATER = plant(54, 21)


def fill(cells: Cells, boxes: tuple[Box, ...], value: bool = True) -> None:
    """Set all cells of boxes."""
    for each in boxes:
        cells[each] = value


def standing() -> Cells:
    """What never moves: floor, walls and furniture, of SHAPE."""
    cells = np.zeros(SHAPE, np.bool_)
    fill(cells, (FLOOR, *WALLS))
    fill(cells, OPENINGS, value=False)
    fill(cells, (*OFFICE, *MEETING_ROOM, *LAB, *KITCHEN))
    return cells


def moving() -> Cells:
    """All cells that anything that moves may ever fill, of SHAPE."""
    cells = np.zeros(SHAPE, np.bool_)
    for door in (MAIN_DOOR, OFFICE_DOOR):
        fill(cells, (door.closed, door.open))
    for seat in SEATS:
        fill(cells, seat.person())
        for shift in SHIFTS if seat in WANDERING_SEATS else (0,):
            fill(cells, seat.chair(shift))
    fill(cells, PLANT_FIRST + PLANT_LATER)
    return cells

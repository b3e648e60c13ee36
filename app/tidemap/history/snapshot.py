"""Snapshots: measurements of one moment, as sensors make them: put in order in one pass; the cells they saw."""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from tidemap.history.jit import kernel
from tidemap.history.measurements import Measurements

Kind = TypeVar("Kind", bound=np.generic)
TYPES: tuple[np.dtype[Any], ...] = (np.dtype(np.float64), np.dtype(np.uint32), np.dtype(np.uint8))


def sort_snapshot(
    time: NDArray[np.generic],
    cell: NDArray[np.generic],
    state: NDArray[np.generic],
    span: tuple[float, float],
    n_cells: int,
) -> Measurements | None:
    """The measurements (n,) in order (`Measurements.in_order`), where they are a plain snapshot; else None.

    That is: at one time, within `span` (both ends may be), states 0 or 1 of distinct cells below `n_cells`, which
    ascend but for one place at most, as those of a robot do that sends what it saw occupied and then what it saw free.
    Arrays of other types than those of `Measurements` are none. O(n), and without the GIL.
    """
    columns = (time, cell, state)
    if not len(time) or any(not _fits(column, dtype) for column, dtype in zip(columns, TYPES, strict=True)):
        return None
    views: list[NDArray[Any]] = [_read_only(column) for column in columns]
    snapshot = Measurements(
        np.broadcast_to(views[0][:1], len(time)), np.empty(len(time), np.uint32), np.empty(len(time), np.uint8)
    )
    return snapshot if _merge(views[0], views[1], views[2], *span, n_cells, snapshot.cell, snapshot.state) else None


def _fits(column: NDArray[np.generic], dtype: np.dtype[np.generic]) -> bool:
    """Whether the kernel is compiled for such an array."""
    return bool(column.dtype == dtype and column.flags.c_contiguous and column.flags.aligned)


def _read_only(column: NDArray[Kind]) -> NDArray[Kind]:
    """As what is compiled takes it: another one would be compiled anew."""
    view = column.view()
    view.flags.writeable = False
    return view


@kernel
def _merge(
    time: NDArray[np.float64],
    cell: NDArray[np.uint32],
    state: NDArray[np.uint8],
    earliest: float,
    latest: float,
    n_cells: int,
    cell_out: NDArray[np.uint32],
    state_out: NDArray[np.uint8],
) -> bool:
    """Fills the last two, ascending by cell; False where these are no plain snapshot."""
    n, first = cell.size, time[0]
    if not (earliest <= first <= latest):
        return False
    border = n
    for i in range(n):
        if time[i] != first or cell[i] >= n_cells or state[i] > 1:
            return False
        if i > 0 and cell[i] <= cell[i - 1]:
            if border < n:
                return False
            border = i
    one, other = 0, border
    for i in range(n):
        if one < border and other < n and cell[one] == cell[other]:
            return False
        if other == n or (one < border and cell[one] < cell[other]):
            cell_out[i], state_out[i] = cell[one], state[one]
            one += 1
        else:
            cell_out[i], state_out[i] = cell[other], state[other]
            other += 1
    return True


def seen_plane(cell: NDArray[np.uint32]) -> NDArray[np.uint8] | None:
    """Which cells from the first of `cell` (n,) to its last are among them: bits, "little", of at most n bytes.

    None where they do not ascend, or are too far apart for that.
    """
    span = int(cell[-1]) - int(cell[0]) if len(cell) else -1
    if not 0 <= span < 8 * len(cell):
        return None
    plane = np.zeros((span >> 3) + 1, np.uint8)
    return plane if _mark(_read_only(cell), plane) else None


def plane_cells(plane: NDArray[np.uint8], first: int, n: int) -> NDArray[np.uint32]:
    """The `n` cells of a `seen_plane` whose first is `first`. ValueError where it does not have so many.

    >>> plane_cells(seen_plane(np.array([7, 8, 20], np.uint32)), 7, 3).tolist()
    [7, 8, 20]
    """
    cell = np.empty(n, np.uint32)
    if _cells(_read_only(plane), first, cell) != n:
        raise ValueError(f"a plane has other than {n} cells")
    return cell


@kernel
def _mark(cell: NDArray[np.uint32], plane: NDArray[np.uint8]) -> bool:
    """Sets the bits of cells, from the first on; False where they do not ascend."""
    for i in range(1, cell.size):
        if cell[i] <= cell[i - 1]:
            return False
    for each in cell:
        off = each - cell[0]
        plane[off >> 3] |= np.uint8(1 << (off & 7))
    return True


@kernel
def _cells(plane: NDArray[np.uint8], first: int, cell: NDArray[np.uint32]) -> int:
    """How many bits are set; as far as there is room, where."""
    found = 0
    for byte in range(plane.size):
        bits = plane[byte]
        if bits == 0:
            continue
        for bit in range(8):
            if bits >> bit & 1:
                if found < cell.size:
                    cell[found] = first + 8 * byte + bit
                found += 1
    return found

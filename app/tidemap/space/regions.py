"""Regions: connected groups of marked cells, and what belongs together of them over time."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tidemap.space.grid import NEIGHBOURS, GridGeometry

STEPS = np.array(NEIGHBOURS, np.int64)
FEW = 64
"""Cells of a pair of groups that are asked about first."""
NEVER = -(1 << 62)
"""Before every sample, and far enough from all to subtract it."""


def label_regions(grid: GridGeometry, sample: NDArray[np.int64], cell: NDArray[np.int64]) -> NDArray[np.int64]:
    """Label (n,) of each marked (sample, cell); the marks are distinct.

    Two marks belong together when they are neighbours (26) in the same sample. O(n log n).
    """
    if not len(cell):
        return np.empty(0, np.int64)
    key = (sample - sample.min()) * grid.n_cells + cell
    order = np.argsort(key)
    parent, label = np.arange(len(key)), np.empty(len(key), np.int64)
    _join(key[order], grid.shape3, STEPS, parent)
    label[order] = _numbered(parent)
    return label


Array = NDArray[np.int64]
WasRead: TypeAlias = Callable[[Array, Array], NDArray[np.bool_]]
"""Whether each cell was read in the sample beside it, (n,) each."""


@dataclass(frozen=True, slots=True, eq=False)
class Spans:
    """Groups with what they consist of, to be joined where they continue one another.

    Row i says that group `label[i]` shows `cell[i]` in `state[i]` (n,); `first` and `last` (m,) are the first and the
    last sample of each group.
    """

    label: Array
    cell: Array
    state: NDArray[np.uint8]
    first: Array
    last: Array


def link(spans: Spans, gap: int, was_read: WasRead | None = None) -> Array:
    """The number (m,) of what each group is part of, when those that continue one another are one.

    Two groups are one when they show a cell in the same state, at most `gap` samples lie between them, and that
    cell `was_read` in none. What they make is joined in the same way, until nothing is left to join; the result
    depends neither on their order nor on the steps taken, as to join only grows cells and spans. A step is
    O(n log n), and few are needed.
    """
    group, label, first, last = np.arange(len(spans.first)), spans.label, spans.first, spans.last
    while True:
        rows = np.lexsort((first[label], spans.state, spans.cell))
        cell, owner = spans.cell[rows], label[rows]
        begin, reach = first[owner], _reached(cell, spans.state[rows], last[owner])
        near = np.flatnonzero(begin - reach <= gap + 1)
        if was_read is not None:
            pair = owner[near - 1] * len(first) + owner[near]
            near = near[_unread(pair, (cell[near], reach[near], begin[near]), gap, was_read)]
        parent = np.arange(len(first))
        if not _unite(owner[near - 1], owner[near], parent):
            return group
        number = _numbered(parent)
        starts, stops = np.full(number.max() + 1, first.max()), np.full(number.max() + 1, last.min())
        np.minimum.at(starts, number, first)
        np.maximum.at(stops, number, last)
        group, label, first, last = number[group], number[label], starts, stops


def _unread(pair: Array, gaps: tuple[Array, Array, Array], gap: int, was_read: WasRead) -> NDArray[np.bool_]:
    """(n,) which gaps (cell, after, before) show that a pair of groups is one: enough of them, if any does.

    Large groups share many cells, and one is enough: of each pair some are asked about first.
    """
    order = np.argsort(pair, kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order)) - np.searchsorted(pair[order], pair[order])
    shown = np.zeros(len(pair), np.bool_)
    for rows in (np.flatnonzero(rank < FEW), np.flatnonzero(rank >= FEW)):
        open_ = rows[~np.isin(pair[rows], pair[shown])]
        cell, after, before = (column[open_] for column in gaps)
        shown[open_] = ~_read_between(cell, after, before, gap, was_read)
    return shown


def _read_between(cell: Array, after: Array, before: Array, gap: int, was_read: WasRead) -> NDArray[np.bool_]:
    """(n,) whether each cell was read in one of the samples, at most `gap`, between two others."""
    found = np.zeros(len(cell), np.bool_)
    for step in range(1, gap + 1):
        rows = np.flatnonzero(after + step < before)
        if rows.size:
            found[rows] |= was_read(cell[rows], after[rows] + step)
    return found


@njit(cache=True, nogil=True)
def _reached(cell: Array, state: NDArray[np.uint8], last: Array) -> Array:
    """The last sample of all rows before each that show its cell in its state, which are together; NEVER of none."""
    reach = np.empty_like(last)
    for i in range(cell.size):
        if i == 0 or cell[i] != cell[i - 1] or state[i] != state[i - 1]:
            reach[i] = NEVER
        else:
            reach[i] = max(reach[i - 1], last[i - 1])
    return reach


@njit(cache=True, nogil=True)
def _unite(one: Array, other: Array, parent: Array) -> int:
    """In place: `parent` of groups that are one with another; how many became part of one."""
    joined = 0
    for i in range(one.size):
        a, b = _root(parent, one[i]), _root(parent, other[i])
        if a != b:
            parent[max(a, b)] = min(a, b)
            joined += 1
    for i in range(parent.size):
        parent[i] = _root(parent, i)
    return joined


@njit(cache=True, nogil=True)
def _join(
    key: NDArray[np.int64], shape: tuple[int, int, int], steps: NDArray[np.int64], parent: NDArray[np.int64]
) -> None:
    """In place: `parent` of every mark (keys ascending) becomes the first of its region."""
    plane, row = shape[1] * shape[2], shape[2]
    n_cells = shape[0] * plane
    for i in range(key.size):
        cell = key[i] % n_cells
        at_x, at_y, at_z = cell // plane, cell // row % shape[1], cell % row
        for step in steps:
            x, y, z = at_x + step[0], at_y + step[1], at_z + step[2]
            if 0 <= x < shape[0] and 0 <= y < shape[1] and 0 <= z < shape[2]:
                _meet(key, parent, i, key[i] + step[0] * plane + step[1] * row + step[2])
    for i in range(key.size):
        parent[i] = _root(parent, i)


@njit(cache=True, nogil=True)
def _numbered(parent: NDArray[np.int64]) -> NDArray[np.int64]:
    """Labels 0, 1 and so on of regions that are given by their first marks, in the order of these."""
    label = np.empty_like(parent)
    count = 0
    for i in range(parent.size):
        if parent[i] == i:
            label[i] = count
            count += 1
        else:
            label[i] = label[parent[i]]
    return label


@njit(cache=True, nogil=True)
def _meet(key: NDArray[np.int64], parent: NDArray[np.int64], mark: int, wanted: int) -> None:
    """Unite the regions of a mark and of the later mark with this key, if there is one."""
    other, above = mark + 1, key.size
    while other < above:
        middle = (other + above) // 2
        if key[middle] < wanted:
            other = middle + 1
        else:
            above = middle
    if other < key.size and key[other] == wanted:
        one, two = _root(parent, mark), _root(parent, other)
        parent[max(one, two)] = min(one, two)


@njit(cache=True, nogil=True)
def _root(parent: NDArray[np.int64], mark: int) -> int:
    """The first mark of a region, as far as it is known; halves the way there."""
    while parent[mark] != mark:
        parent[mark] = parent[parent[mark]]
        mark = parent[mark]
    return mark

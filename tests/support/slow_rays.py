"""The slow truth of ray casting, from the definition: a ray passes a cell if more than a point of it is inside."""

from collections import Counter
from collections.abc import Iterable, Sequence
from fractions import Fraction
from itertools import pairwise
from math import ceil, floor
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Index: TypeAlias = tuple[int, ...]
Exact: TypeAlias = Sequence[Fraction]
SLIVER = 1e-9
"""Shares of a ray, and lengths in cells, that may be rounded away."""


def exact_path(start: Exact, end: Exact) -> list[Index]:
    """The cells that a ray has more than a point in, in its order; coordinates in cells.

    Between two neighbouring crossings of faces a ray stays in one cell, which is that of the middle. The numbers are
    rational, so nothing is rounded.
    """
    shares = {Fraction(0), Fraction(1)}
    for a, b in zip(start, end, strict=True):
        low, high = min(a, b), max(a, b)
        shares |= {(face - a) / (b - a) for face in range(floor(low) + 1, ceil(high))}
    middles = [(one + other) / 2 for one, other in pairwise(sorted(shares))] if start != end else []
    return [tuple(floor(a + at * (b - a)) for a, b in zip(start, end, strict=True)) for at in middles]


def exact_states(shape: Index, start: Exact, ends: Iterable[Exact], min_hits: int) -> dict[Index, int]:
    """The state by cell of the grid that whole rays give."""
    hits: Counter[Index] = Counter()
    passed: set[Index] = set()
    for end in ends:
        stop = tuple(map(floor, end))
        passed |= set(exact_path(start, end)) - {stop}
        hits[stop] += 1
    states = dict.fromkeys(passed, 0) | {cell: 1 for cell, count in hits.items() if count >= min_hits}
    return {cell: state for cell, state in states.items() if is_inside(shape, cell)}


def is_inside(shape: Index, cell: Index) -> bool:
    return all(0 <= at < n for at, n in zip(cell, shape, strict=True))


def met(shape: Index, start: NDArray[np.float64], end: NDArray[np.float64], margin: float) -> NDArray[np.bool_]:
    """Which cells of the grid (`shape`), grown by `margin` on all sides, the ray meets: every cell is asked."""
    low = np.moveaxis(np.indices(shape), 0, -1) - margin
    high, way = low + 1 + 2 * margin, end - start
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        one, other = (low - start) / way, (high - start) / way
    along = (low <= start) & (start <= high)
    enter = np.where(way == 0, np.where(along, -np.inf, np.inf), np.minimum(one, other)).max(axis=-1)
    leave = np.where(way == 0, np.inf, np.maximum(one, other)).min(axis=-1)
    return np.asarray((np.maximum(enter, 0) <= np.minimum(leave, 1)), np.bool_)


def rounded_path(start: NDArray[np.float64], end: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """As `exact_path`, in floating-point numbers: the cells (n, 3) surely passed, and those of slivers (m, 3)."""
    faces = [
        (np.arange(np.floor(min(a, b)) + 1, np.ceil(max(a, b))) - a) / (b - a)
        for a, b in zip(start, end, strict=True)
        if a != b
    ]
    shares = np.sort(np.concatenate([[0.0, 1.0], *faces]))
    middles = (shares[1:] + shares[:-1])[:, np.newaxis] / 2
    cells = np.floor(start + middles * (end - start)).astype(np.int64)
    sliver = np.diff(shares) * np.linalg.norm(end - start) < SLIVER
    return cells[~sliver], cells[sliver]

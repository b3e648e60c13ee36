"""Painting: the code of every cell's colour in both grids, and which tiles have changed, in one pass over the blocks of
cells that can have changed."""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tidemap.history.history import NEVER
from tidemap.history.jit import kernel

HIDDEN: Final = np.uint16(0xFFFF)
TILE: Final = 1 << 14
"""Cells of a tile: what a browser is sent together. One that changes costs 3 to 9 bytes for each of its cells."""
BLOCK: Final = 1 << 10
"""Cells that are painted together, or stay as they are; a tile has whole blocks."""
LEVELS: Final = 256
MARKS: Final = 6
COUNTS: Final = 6
IS_UNEXPECTED, IS_MISSING, IS_STALE, IS_WALL, SHOWN_LEFT, SHOWN_RIGHT = range(COUNTS)
"""What is counted: three marks, what is always occupied, and the cells that each grid shows."""
NOTHING, OCCUPIED, EXPECTED_FREE, UNEXPECTED, MISSING, STALE = range(MARKS)
BY_PROBABILITY, BY_MARK, BY_AGE, BY_DIFFERENCE, BY_DAY = range(5)
WALL: Final = np.float32(0.95)
"""Probability from which on what is always occupied counts as a wall now."""
EVER: Final = int(np.iinfo(np.int64).max)
SWING: Final = np.float32(2 / np.pi)
"""The amplitude of a day with a half occupied and a half free: there is no higher one of a first harmonic."""
RECOLOURED, RESHAPED = np.uint8(1), np.uint8(2)
"""What has become of a tile: other colours of the same cells; other cells."""


@kernel
def mark_of(seen: Any, fresh: bool, p: Any, confidence: Any) -> Any:
    """What a sighting says beside what was expected. An old one says nothing about now."""
    if seen == 1:
        if not fresh:
            return STALE
        return UNEXPECTED if np.float32(1) - p > confidence else OCCUPIED
    if seen == 0:
        return MISSING if fresh and p > confidence else EXPECTED_FREE
    return NOTHING


@kernel
def row_of(source: int, mark: int, seen: Any, fresh: bool, step: int, p: Any, swing: Any, limits: Any) -> int:
    """The row of a layer's table that a cell has; -1 where the layer does not show it. limits: as rules of `paint`."""
    confidence, free_below, floor = limits
    if source == BY_PROBABILITY:
        if not p >= floor:  # nor where there is no model, and p is NaN
            return -1
        verdict = 1 if p > confidence else 0 if p < free_below else 2
        return verdict * LEVELS + int(p * np.float32(255) + np.float32(0.5))
    if source == BY_MARK:
        return mark
    if source == BY_DAY:
        return int(min(swing / SWING, np.float32(1)) * np.float32(255) + np.float32(0.5)) if swing == swing else -1
    if seen > 1:
        return -1
    if source == BY_AGE:
        return step
    if source == BY_DIFFERENCE and fresh and p == p:
        return int((np.float32(seen) - p + np.float32(1)) * np.float32(127.5) + np.float32(0.5))
    return -1


@kernel
def predicted_code(over: Any, says: Any, covered: bool, grey: Any) -> Any:
    """What the left grid shows: a mark over it, or what the layer says, or a grey that covers that."""
    if over != HIDDEN:
        return over
    return grey if covered else says


@kernel
def change(before: Any, after: Any) -> Any:
    """What becomes of a cell's tile where its code changes."""
    if before == after:
        return np.uint8(0)
    return RESHAPED if before == HIDDEN or after == HIDDEN else RECOLOURED


@kernel
def _equal(one: Any, other: Any) -> bool:
    """Whether two numbers are the same; NaN is itself."""
    return bool(one == other or (one != one and other != other))


@kernel
def due(
    number: NDArray[np.int32],
    p_of: NDArray[np.float32],
    state: NDArray[np.uint8],
    sample: NDArray[np.int64],
    p_before: NDArray[np.float32],
    state_before: NDArray[np.uint8],
    sample_before: NDArray[np.int64],
    oldest: int,
    holds: NDArray[np.int64],
    blocks: NDArray[np.bool_],
) -> None:
    """Write `blocks` (n_blocks,): those where anything that `paint` was given is another than before.

    oldest: the oldest sample that is judged. The rest as for `paint`.
    """
    for block in range(blocks.size):
        blocks[block] = not (holds[0, block] < oldest <= holds[1, block])
        i, stop = block * BLOCK, min((block + 1) * BLOCK, number.size)
        while i < stop and not blocks[block]:
            cell = np.uint32(number[i])
            same = state[cell] == state_before[cell] and sample[cell] == sample_before[cell]
            blocks[block] = not (same and _equal(p_of[cell], p_before[cell]))
            i += 1


@kernel
def paint(
    blocks: NDArray[np.bool_],
    number: NDArray[np.int32],
    grey: NDArray[np.uint16],
    inside: NDArray[np.bool_],
    p_of: NDArray[np.float32],
    swing_of: NDArray[np.float32],
    state: NDArray[np.uint8],
    sample: NDArray[np.int64],
    always: NDArray[np.bool_],
    limits: tuple[Any, ...],
    moment: tuple[int, int],
    dim: bool,
    sources: tuple[int, int],
    walls: tuple[bool, bool],
    left: NDArray[np.uint16],
    right: NDArray[np.uint16],
    over: NDArray[np.uint16],
    ages: NDArray[np.int64],
    codes: NDArray[np.uint16],
    holds: NDArray[np.int64],
    counts: NDArray[np.int64],
    changed: NDArray[np.uint8],
) -> None:
    """Write `codes` (2, n), `holds` (2, n_blocks) and `counts` (n_blocks, COUNTS) of some blocks anew, and set bits of
    `changed` (2, n_tiles). A block is as it is while the oldest sample that is judged lies in (holds[0], holds[1]].

    blocks (n_blocks,): which. number, grey, inside (n,): of the cells to draw, inside: whether they are not cut away.
    p_of, state, sample, always (n_cells,): p, what was last seen, its sample, whether always occupied. swing_of: p's
    amplitude over the day, (n_cells,) where a layer asks for it. limits: confidence, 1 - confidence and floor, float32.
    moment: the oldest sample that is judged, and the one that is shown. dim: whether walls are grey. sources, walls,
    left, right: of each grid's layer. over (MARKS,): what the left grid shows of marks, HIDDEN for nothing else. ages:
    in samples, ascending. Every array is an argument of its own: taken out of a tuple it would be counted for every
    cell.
    """
    aged, by_day = BY_AGE in sources, sources[0] == BY_DAY
    for block in range(blocks.size):
        if not blocks[block]:
            continue
        left_bits = right_bits = np.uint8(0)
        n_unexpected = n_missing = n_stale = n_walls = n_left = n_right = 0
        latest_stale, oldest_fresh = NEVER, EVER
        for i in range(block * BLOCK, min((block + 1) * BLOCK, number.size)):
            first = second = HIDDEN
            if inside[i]:
                cell = np.uint32(number[i])
                p, seen, at = p_of[cell], state[cell], sample[cell]
                fresh = seen < 2 and at >= moment[0]
                if fresh:
                    oldest_fresh = min(oldest_fresh, at)
                else:
                    latest_stale = max(latest_stale, at)
                mark = mark_of(seen, fresh, p, limits[0])
                wall = dim and always[cell] and p >= WALL
                n_walls += wall
                n_unexpected += mark == UNEXPECTED
                n_missing += mark == MISSING
                n_stale += mark == STALE and not wall
                step = 0
                while aged and step < ages.size and moment[1] - at >= ages[step]:
                    step += 1
                swing = swing_of[cell] if by_day else np.float32(0)
                row = row_of(sources[0], mark, seen, fresh, step, p, swing, limits)
                says = left[row] if row >= 0 else HIDDEN
                first = predicted_code(over[mark], says, row >= 0 and wall and walls[0], grey[i])
                row = row_of(sources[1], mark, seen, fresh, step, p, swing, limits)
                if row >= 0:
                    second = grey[i] if wall and walls[1] and mark in (OCCUPIED, STALE) else right[row]
            n_left += first != HIDDEN
            n_right += second != HIDDEN
            left_bits |= change(codes[0, i], first)
            right_bits |= change(codes[1, i], second)
            codes[0, i], codes[1, i] = first, second
        changed[0, block * BLOCK // TILE] |= left_bits
        changed[1, block * BLOCK // TILE] |= right_bits
        holds[0, block], holds[1, block] = latest_stale, oldest_fresh
        counted = (n_unexpected, n_missing, n_stale, n_walls, n_left, n_right)
        for what in range(COUNTS):
            counts[block, what] = counted[what]

"""Combining: which of several measurements of a cell in one sample stands. Order and batches never matter.

`latest`: the one with the latest time; of two at the same time the occupied one.
`any`: an occupied one where there is any; of those, or else of all, the latest.
`majority`: occupied where at least half of them are; its time is that of the latest.
"""

import numpy as np
from numpy.typing import NDArray

from tidemap.history.jit import kernel

LATEST, ANY, MAJORITY = "latest", "any", "majority"
KEYS = {LATEST: (2, 1), ANY: (1, 1 << 31)}
"""What the rank of a time and a state weigh: the greater sum stands."""


def votes_of(state: NDArray[np.uint8]) -> NDArray[np.int32]:
    """What each measurement (n,) says: 1 occupied, -1 free."""
    return np.where(state != 0, np.int32(1), np.int32(-1))


@kernel
def put_single(
    observed: NDArray[np.uint8],
    occupied: NDArray[np.uint8],
    cell: NDArray[np.int64],
    sample: NDArray[np.int64],
    state: NDArray[np.uint8],
) -> None:
    """Write measurements; no two of them have the same sample and different times."""
    for i in range(cell.size):
        row, byte = cell[i], sample[i] >> 3
        mask = np.uint8(1) << np.uint8(sample[i] & 7)
        observed[row, byte] |= mask
        if state[i]:
            occupied[row, byte] |= mask


@kernel
def put_ranked(
    observed: NDArray[np.uint8],
    occupied: NDArray[np.uint8],
    rank: NDArray[np.int32],
    cell: NDArray[np.int64],
    sample: NDArray[np.int64],
    entry: NDArray[np.int32],
    state: NDArray[np.uint8],
    by_time: int,
    by_state: int,
) -> None:
    """Write the measurements that stand by one of KEYS; `entry` is the rank of each, -1 in `rank` is unobserved."""
    for i in range(cell.size):
        row, n = cell[i], sample[i]
        mask = np.uint8(1) << np.uint8(n & 7)
        before = np.int64(rank[row, n]) * by_time + (by_state if occupied[row, n >> 3] & mask else 0)
        if np.int64(entry[i]) * by_time + (by_state if state[i] else 0) < before:
            continue
        rank[row, n] = entry[i]
        observed[row, n >> 3] |= mask
        if state[i]:
            occupied[row, n >> 3] |= mask
        else:
            occupied[row, n >> 3] &= ~mask


@kernel
def put_votes(
    observed: NDArray[np.uint8],
    occupied: NDArray[np.uint8],
    surplus: NDArray[np.int32],
    rank: NDArray[np.int32],
    cell: NDArray[np.int64],
    sample: NDArray[np.int64],
    entry: NDArray[np.int32],
    votes: NDArray[np.int32],
) -> None:
    """Count what measurements say; `surplus` is what was counted beyond the vote of the state that stands."""
    for i in range(cell.size):
        row, n = cell[i], sample[i]
        mask = np.uint8(1) << np.uint8(n & 7)
        total = votes[i]
        if rank[row, n] >= 0:
            total += surplus[row, n] + (1 if occupied[row, n >> 3] & mask else -1)
        rank[row, n] = max(rank[row, n], entry[i])
        observed[row, n >> 3] |= mask
        if total >= 0:
            occupied[row, n >> 3] |= mask
            surplus[row, n] = total - 1
        else:
            occupied[row, n >> 3] &= ~mask
            surplus[row, n] = total + 1

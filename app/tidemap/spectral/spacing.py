"""Spacing: how far a cell's observations are apart, and so which frequencies they can tell from one another."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from tidemap.history.bits import Plane
from tidemap.history.history import History
from tidemap.history.jit import kernel

DENSE: Final = 2 / 3
"""Where so many of the samples were observed, most of them are neighbours."""
ORDINARY: Final = 3
"""Gaps of so many medians or more are pauses."""
ALIKE: Final = 0.4
"""Standard deviation of the ordinary gaps, as a share of their mean, up to which they count as alike; of visits at
random times it is .45 and more."""


def spacing(history: History, rows: NDArray[np.int64]) -> NDArray[np.float64]:
    """How many samples the observations of some cells are apart, (n_rows,) float64, 1 at least.

    Of gaps that are alike, but for pauses and some jitter, their median or mean, whichever is greater: frequencies
    from half a cycle a spacing on are aliases of lower ones. Visits at random times tell more than regular ones as
    many would: of theirs it is the gap that a tenth of them falls short of. Reads the bits of cells with many
    unobserved samples once.
    """
    found = np.ones(rows.size, np.float64)
    n_observed = history.count_observed()[rows]
    sparse = np.flatnonzero((n_observed > 1) & (n_observed < DENSE * history.n_samples))
    if sparse.size:
        apart = np.empty(sparse.size, np.float64)
        _spacing(history.observed, rows[sparse], history.n_samples, n_observed[sparse], apart)
        found[sparse] = apart
    return found


@kernel
def _spacing(
    observed: Plane, row: NDArray[np.int64], n_samples: int, n_observed: NDArray[np.int64], out: NDArray[np.float64]
) -> None:
    for i in range(row.size):
        gap = np.empty(n_observed[i] - 1, np.int64)
        _gaps(observed, row[i], n_samples, gap)
        gap.sort()
        median = gap[gap.size // 2]
        ordinary = gap[: np.searchsorted(gap, ORDINARY * median + 1)]
        mean = ordinary.mean()
        if median == 1:
            out[i] = 1.0
        elif ordinary.std() <= ALIKE * mean:
            out[i] = max(float(median), mean)
        else:
            out[i] = float(gap[gap.size // 10])


@kernel
def _gaps(observed: Plane, row: int, n_samples: int, gap: NDArray[np.int64]) -> None:
    """In place: the samples between neighbouring observations of a cell."""
    n, last = 0, -1
    for byte in range(observed.shape[1]):
        if observed[row, byte] == 0:
            continue
        for bit in range(8):
            at = 8 * byte + bit
            if at < n_samples and (observed[row, byte] >> np.uint8(bit)) & np.uint8(1):
                if last >= 0:
                    gap[n] = at - last
                    n += 1
                last = at

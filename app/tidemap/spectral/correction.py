"""Correction: how much longer, or less long, states last than a formula of few parameters says (DESIGN 2.8)."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tidemap.history.jit import kernel

DELTA_STEP: Final = 2.0
"""Of a distance in the table to the one before it."""
AGE_STEP: Final = 4.0
"""Of an age in the table to the one before it."""


@dataclass(frozen=True, slots=True, eq=False)
class LastingCorrection:
    """What is added to ln(r / (1 − r)), by the state that was read, how long ago, and how long it had lasted then.

    value: (2, n_deltas, n_ages) float64, two of each at least, at distances of DELTA_STEP^i and ages of AGE_STEP^j
    samples of `interval_s`; linear in the logarithms between them, and constant beyond. ValueError for other shapes.
    """

    interval_s: float
    value: NDArray[np.float64]

    def __post_init__(self) -> None:
        shape = self.value.shape
        if len(shape) != 3 or shape[0] != 2 or min(shape[1:]) < 2 or not np.isfinite(self.value).all():
            raise ValueError(f"finite numbers of two states at two distances and ages or more are needed, not {shape}")

    def at(self, state: ArrayLike, delta_s: ArrayLike, age_s: ArrayLike) -> NDArray[np.float64]:
        """What is added, of the shape of all together.

        >>> table = LastingCorrection(60.0, np.array([[[0, 0], [0, 0]], [[0, 1], [2, 3]]]))
        >>> table.at(1, [60.0, 120.0, 60.0], [60, 60, 240])
        array([0., 2., 1.])
        """
        row = np.where(np.asarray(state) != 0, 1, 0)
        return np.asarray(sum(part * self.value[row, i, j] for i, j, part in self.corners(delta_s, age_s)))

    def corners(
        self, delta_s: ArrayLike, age_s: ArrayLike
    ) -> list[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]]:
        """The four entries that a value lies between, distance and age, and what each of them counts."""
        _, n_deltas, n_ages = self.value.shape
        i, above = _position(np.asarray(delta_s, np.float64) / self.interval_s, DELTA_STEP, n_deltas)
        j, older = _position(np.asarray(age_s, np.float64) / self.interval_s, AGE_STEP, n_ages)
        return [
            (i, j, (1 - above) * (1 - older)),
            (i, j + 1, (1 - above) * older),
            (i + 1, j, above * (1 - older)),
            (i + 1, j + 1, above * older),
        ]


NO_CORRECTION: Final = LastingCorrection(1.0, np.zeros((2, 2, 2)))


def _position(samples: NDArray[np.float64], step: float, n: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The entry below, the last but one at most, and how far on the way to the next it is, 0 to 1."""
    at = np.clip(np.log(np.maximum(samples, 1)) / np.log(step), 0, n - 1)
    below = np.minimum(at.astype(np.int64), n - 2)
    return below, at - below


@kernel
def correction_at(value: NDArray[np.float64], state: Any, delta: float, age: float) -> float:
    """`LastingCorrection.at` of one reading, in samples."""
    n_deltas, n_ages = value.shape[1:]
    x = min(np.log2(max(1.0, delta)) / np.log2(DELTA_STEP), n_deltas - 1.0)
    y = min(np.log2(max(1.0, age)) / np.log2(AGE_STEP), n_ages - 1.0)
    i, j, row = min(int(x), n_deltas - 2), min(int(y), n_ages - 2), 1 if state == 1 else 0
    near = value[row, i, j] + (y - j) * (value[row, i, j + 1] - value[row, i, j])
    far = value[row, i + 1, j] + (y - j) * (value[row, i + 1, j + 1] - value[row, i + 1, j])
    return float(near + (x - i) * (far - near))

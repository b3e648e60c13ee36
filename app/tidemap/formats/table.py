"""Columns of measurements and of answers, as every format reads and writes them."""

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tidemap.space.grid import GridGeometry


@dataclass(frozen=True, slots=True, eq=False)
class Labels:
    """Words by code: codes (n,) or (n, m) uint8, indices into `names`."""

    codes: NDArray[np.uint8]
    names: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Nullable:
    """Values, some unknown: values and missing, both (n,) or (n, m)."""

    values: NDArray[Any]
    missing: NDArray[np.bool_]


Column: TypeAlias = NDArray[Any] | Labels | Nullable


def without_nan(state: NDArray[np.floating[Any]]) -> tuple[NDArray[np.int64], NDArray[np.bool_] | None]:
    """States (n,) that are NaN where a sensor is unavailable, as integers: 0 there, and -1 where they are no states.

    Then where it is unavailable; None where it is nowhere.
    """
    missing = np.isnan(state)
    whole = np.where(np.isin(state, (0, 1)), state, np.where(missing, 0, -1)).astype(np.int64)
    return whole, missing if missing.any() else None


def wanted(grid: GridGeometry) -> list[str]:
    """The columns of a table of measurements."""
    return ["state", "time"] if grid.is_single else ["cell", "state", "time"]

"""Columns of an answer, as every format writes them."""

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray


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

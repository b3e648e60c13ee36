"""Records: what files hold, before it is put on a location's grid."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tidemap.space.grid import GridGeometry
from tidemap.space.sweep import Sweep


def states(values: Sequence[float]) -> NDArray[np.uint8] | NDArray[np.float32]:
    """States 1, 0 and NaN (n,) as bytes; as floats where some are NaN."""
    found = np.array(values, np.float32)
    return found if np.isnan(found).any() else found.astype(np.uint8)


@dataclass(frozen=True, slots=True, eq=False)
class StateReadings:
    """States of one cell: time (n,) float64 Unix seconds, state (n,), 1 occupied, 0 free and NaN unavailable."""

    time: NDArray[np.float64]
    state: NDArray[np.uint8] | NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class WholeMap:
    """The state of every cell of a grid at a time: state (n_cells,) uint8 as `formats.npy` has it."""

    time: float
    grid: GridGeometry
    state: NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Missing:
    """What cannot be used, and why: it has no pose."""

    time: float
    why: str


Record: TypeAlias = StateReadings | WholeMap | Sweep | Missing


class ImportSource(Protocol):
    """One stream of records: a file, or a topic of a bag."""

    @property
    def path(self) -> Path:
        """The file or folder."""

    @property
    def what(self) -> str:
        """What it is, such as `CSV` or `/scan (sensor_msgs/msg/LaserScan)`."""

    @property
    def kind(self) -> Literal["state", "grid"]:
        """What locations it is for."""

    def records(self) -> Iterator[Record]:
        """Its records, read anew each time. Raises UnreadableBodyError."""

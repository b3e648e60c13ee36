"""Survey: what sources hold, found by reading all of it before anything is posted."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tidemap.importing.files import naming
from tidemap.importing.records import ImportSource, Missing, Record, StateReadings, WholeMap
from tidemap.schemas.common import iso
from tidemap.space.grid import GridGeometry


@dataclass(slots=True, eq=False)
class Findings:
    """What one source holds; its cells are in space where its kind is `grid`.

    first, last: Unix seconds, infinite and reversed where there is nothing. low, high (3,): the box around all that was
    seen and all sensors, metres. grid: that of a map, if all maps have one. flat: nothing has a height. missing: how
    many records cannot be used; reason: why the first of them.
    """

    path: str
    what: str
    kind: Literal["state", "grid"]
    records: int = 0
    measurements: int = 0
    first: float = np.inf
    last: float = -np.inf
    low: NDArray[np.float64] = field(default_factory=lambda: np.full(3, np.inf))
    high: NDArray[np.float64] = field(default_factory=lambda: np.full(3, -np.inf))
    grid: GridGeometry | None = None
    maps: int = 0
    coarsest_m: float = 0.0
    flat: bool = True
    missing: int = 0
    reason: str | None = None

    def add(self, record: Record) -> None:
        """One more record."""
        if isinstance(record, Missing):
            self.missing += 1
            self.reason = self.reason or record.why
            return
        self.records += 1
        times = record.time if isinstance(record, StateReadings) else np.array([record.time])
        if times.size:
            self.first, self.last = min(self.first, float(times.min())), max(self.last, float(times.max()))
        if isinstance(record, StateReadings):
            self.measurements += len(record.time)
        elif isinstance(record, WholeMap):
            self._add_map(record.grid)
        else:
            self.measurements += len(record.points)
            self.flat &= record.flat
            self._reach(record.reach())

    def _add_map(self, grid: GridGeometry) -> None:
        self.grid = grid if self.maps == 0 or grid == self.grid else None
        self.maps += 1
        self.coarsest_m = max(self.coarsest_m, grid.resolution_m)
        self.measurements += grid.n_cells
        self.flat &= grid.shape3[2] == 1
        corner = np.array(grid.origin)
        self._reach(np.stack([corner, corner + np.array(grid.shape3) * grid.resolution_m]))

    def _reach(self, points: NDArray[np.float64]) -> None:
        self.low, self.high = np.minimum(self.low, points.min(axis=0)), np.maximum(self.high, points.max(axis=0))

    @property
    def n_all(self) -> int:
        """Records, with those that cannot be used."""
        return self.records + self.missing

    def described(self) -> dict[str, Any]:
        """As plain values."""
        times = [iso(self.first), iso(self.last)] if self.first <= self.last else None
        extent = [self.low.tolist(), self.high.tolist()] if np.isfinite(self.low).all() else None
        facts = {"file": self.path, "source": self.what, "kind": self.kind, "records": self.records}
        facts |= {"measurements": self.measurements, "times": times, "extent_m": extent}
        return facts | {"missing": self.missing, "reason": self.reason}

    def __str__(self) -> str:
        said = self.described()
        parts = [f"{self.path}: {self.what}: {self.records} records, {self.measurements} measurements"]
        if said["times"]:
            parts.append(f"from {said['times'][0]} to {said['times'][1]}")
        if said["extent_m"]:
            parts.append("reaching from {} to {} m".format(*(corner_text(corner) for corner in said["extent_m"])))
        if self.missing:
            parts.append(f"{self.missing} cannot be used: {self.reason}")
        return ", ".join(parts)


def corner_text(corner: Iterable[float]) -> str:
    """A corner of a box, to the centimetre."""
    return "(" + ", ".join(f"{value:.2f}" for value in corner) + ")"


def survey(sources: Iterable[ImportSource], step: Callable[[int], object]) -> list[Findings]:
    """What each source holds; `step` is called with 1 for each record. Raises UnusableFileError."""
    return [_surveyed(source, step) for source in sources]


def _surveyed(source: ImportSource, step: Callable[[int], object]) -> Findings:
    found = Findings(str(source.path), source.what, source.kind)
    with naming(source.path):
        for record in source.records():
            found.add(record)
            step(1)
    return found

"""Spectrum: the mean and the waves of every cell, one shape for all estimators."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tidemap.history.timebase import TimeBase
from tidemap.spectral.civil import DAY_S, week_seconds

Link = Literal["identity", "logit"]

EVERY_DAY: Final = 0
WEEKEND: Final = 1


@dataclass(frozen=True, slots=True, eq=False)
class Spectrum:
    """P: p(t) = link⁻¹(mean + 2 Re Σ coefficient · gate(t) · exp(2πi · frequency · τ(t))).

    frequency_hz (n_waves,) float64 and gate (n_waves,) uint8: the table of waves, each once.
    mean (n_cells,) float32, on the scale of the link, NaN where never observed.
    cell (n_varying,) int32, ascending: the cells that have waves; index (n_varying, order) uint16
    or uint32 into the table; coefficient (n_varying, order) complex64, descending in magnitude,
    padded with zeros. τ(t) is `tau`, the same all over a sample of `base`: p(t) is the expectation for
    the sample that contains t. The weekend gate passes days 5 and 6 of weeks of τ. Public holidays of `calendar`
    (an ISO 3166 code) count as Sundays.
    """

    link: Link
    origin_s: float
    time_zone: str | None
    frequency_hz: NDArray[np.float64]
    gate: NDArray[np.uint8]
    mean: NDArray[np.float32]
    cell: NDArray[np.int32]
    index: NDArray[np.uint16] | NDArray[np.uint32]
    coefficient: NDArray[np.complex64]
    base: TimeBase
    calendar: str | None = None

    def __post_init__(self) -> None:
        n_varying, order = self.coefficient.shape
        if self.index.shape != (n_varying, order) or self.cell.shape != (n_varying,):
            raise ValueError("cell, index and coefficient differ in length or order")
        if self.frequency_hz.shape != self.gate.shape:
            raise ValueError("frequency_hz and gate differ in length")
        if n_varying and order and not self.frequency_hz.size:
            raise ValueError("cells with waves need a table of waves")

    @property
    def n_cells(self) -> int:
        return int(self.mean.size)

    @property
    def n_waves(self) -> int:
        return int(self.frequency_hz.size)

    @property
    def order(self) -> int:
        """The greatest number of components of a cell."""
        return int(self.coefficient.shape[1])


@dataclass(frozen=True, slots=True, eq=False)
class Components:
    """The processes of one cell, greatest first: amplitude cos(2π frequency_hz τ + phase), (n,) each.

    amplitude = 2 |coefficient|, phase in radians, frequency_hz, gate.
    """

    amplitude: NDArray[np.float64]
    phase: NDArray[np.float64]
    frequency_hz: NDArray[np.float64]
    gate: NDArray[np.uint8]


def static(mean: NDArray[np.float32], base: TimeBase, origin_s: float = 0.0, link: Link = "identity") -> Spectrum:
    """A spectrum of means alone."""
    return Spectrum(
        link=link,
        origin_s=origin_s,
        time_zone=None,
        frequency_hz=np.zeros(0),
        gate=np.zeros(0, np.uint8),
        mean=mean,
        cell=np.zeros(0, np.int32),
        index=np.zeros((0, 0), np.uint16),
        coefficient=np.zeros((0, 0), np.complex64),
        base=base,
    )


def blank(like: Spectrum, n_cells: int) -> Spectrum:
    """Cells that were never observed, on the scale of another spectrum and with its order."""
    return replace(
        like,
        mean=np.full(n_cells, np.nan, np.float32),
        cell=np.zeros(0, np.int32),
        index=like.index[:0],
        coefficient=like.coefficient[:0],
    )


def tau(spectrum: Spectrum, time: ArrayLike) -> NDArray[np.float64]:
    """τ(t) in seconds, of the shape of `time` (Unix seconds), the same for all of the sample that contains t.

    Seconds from origin_s, where a sample starts, to the start of that sample; in a time zone the civil seconds of its
    middle since Monday, 5 January 1970, in which a public holiday is the Sunday of its week. All that evaluates a
    spectrum at a time comes through here, so that predicting, judging, fitting and showing mean the same p(t).
    """
    if spectrum.time_zone is None:
        return np.asarray(spectrum.base.time(spectrum.base.sample(time)) - spectrum.origin_s)
    return week_seconds(spectrum.base.middle_of(time), spectrum.time_zone, spectrum.calendar)


def gates(spectrum: Spectrum, tau_s: NDArray[np.float64]) -> NDArray[np.bool_]:
    """gate(t), (n_waves, *tau_s.shape)."""
    weekend = np.floor_divide(tau_s, DAY_S) % 7 >= 5
    every_day = spectrum.gate.reshape((-1,) + (1,) * tau_s.ndim) == EVERY_DAY
    return np.asarray(every_day | weekend)


def truncate(spectrum: Spectrum, order: int) -> Spectrum:
    """The first `order` components of every cell; waves no longer used leave the table."""
    if order < 0:
        raise ValueError(f"order must not be negative: {order}")
    if order >= spectrum.order:
        return spectrum
    if order == 0:
        return _without_waves(spectrum)
    kept = replace(
        spectrum,
        index=spectrum.index[:, :order].copy(),
        coefficient=spectrum.coefficient[:, :order].copy(),
    )
    return compact(kept)


def select(spectrum: Spectrum, cells: ArrayLike) -> Spectrum:
    """The spectrum of these cells, renumbered 0, 1, … in the given order; repeats are allowed."""
    chosen = np.asarray(cells, np.int64)
    row = rows(spectrum, chosen)
    varying = np.flatnonzero(row >= 0)
    kept = row[varying]
    return replace(
        spectrum,
        mean=spectrum.mean[chosen],
        cell=varying.astype(np.int32),
        index=spectrum.index[kept],
        coefficient=spectrum.coefficient[kept],
    )


def rows(spectrum: Spectrum, cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Where the waves of each cell are in index and coefficient; -1 where it has none.

    IndexError on a cell outside [0, n_cells).
    """
    check_cells(spectrum, cells)
    if not spectrum.cell.size:
        return np.full(cells.shape, -1, np.int64)
    row = np.searchsorted(spectrum.cell, cells)
    row[row == spectrum.cell.size] = 0
    return np.where(spectrum.cell[row] == cells, row, -1).astype(np.int64)


def check_cells(spectrum: Spectrum, cells: ArrayLike) -> NDArray[np.int64]:
    """The cells (n,) as integers. IndexError on one outside [0, n_cells)."""
    chosen = np.asarray(cells, np.int64)
    if chosen.size and (chosen.min() < 0 or chosen.max() >= spectrum.n_cells):
        raise IndexError(f"a cell outside [0, {spectrum.n_cells})")
    return chosen


def components(spectrum: Spectrum, cell: int) -> Components:
    """The components of one cell, greatest first, padding left out."""
    row = int(rows(spectrum, np.array([cell], np.int64))[0])
    if row < 0:
        none = np.zeros(0)
        return Components(none, none, none, np.zeros(0, np.uint8))
    coefficient = spectrum.coefficient[row].astype(np.complex128)
    kept = coefficient != 0
    wave = spectrum.index[row][kept]
    coefficient = coefficient[kept]
    return Components(
        amplitude=2 * np.abs(coefficient),
        phase=np.angle(coefficient),
        frequency_hz=spectrum.frequency_hz[wave],
        gate=spectrum.gate[wave],
    )


def compact(spectrum: Spectrum) -> Spectrum:
    """The same with only the waves that are used in the table, its order kept."""
    used = np.zeros(spectrum.n_waves, np.bool_)
    used[spectrum.index[spectrum.coefficient != 0]] = True
    if used.all():
        return spectrum
    if not used.any():
        return _without_waves(spectrum)
    position = np.maximum(np.cumsum(used) - 1, 0)
    return replace(
        spectrum,
        frequency_hz=spectrum.frequency_hz[used],
        gate=spectrum.gate[used],
        index=position.astype(index_type(int(used.sum())))[spectrum.index],
    )


def index_type(n_waves: int) -> type[np.uint16] | type[np.uint32]:
    """The smaller of the two that can count `n_waves`."""
    return np.uint16 if n_waves <= 1 << 16 else np.uint32


def concatenate(spectra: Sequence[Spectrum]) -> Spectrum:
    """One spectrum of the cells of all, in order; the wave tables are united and sorted.

    ValueError where link, origin, time zone, calendar or time base differ, or there is none.
    """
    if not spectra:
        raise ValueError("nothing to concatenate")
    first = spectra[0]
    if any(_scale(each) != _scale(first) for each in spectra):
        raise ValueError("the spectra differ in link, origin, time zone, calendar or time base")
    waves, inverse = _unite(spectra)
    order = max(each.order for each in spectra)
    offset = np.cumsum([0] + [each.n_cells for each in spectra])
    coefficient = np.concatenate([_pad(each.coefficient, order) for each in spectra])
    position = np.split(inverse.astype(index_type(waves.size)), np.cumsum([each.n_waves for each in spectra]))
    index = np.concatenate([_pad(at[each.index], order) for each, at in zip(spectra, position[:-1], strict=True)])
    return replace(
        first,
        frequency_hz=np.ascontiguousarray(waves["frequency_hz"]),
        gate=np.ascontiguousarray(waves["gate"]),
        mean=np.concatenate([each.mean for each in spectra]),
        cell=np.concatenate([each.cell + np.int32(start) for each, start in zip(spectra, offset[:-1], strict=True)]),
        index=np.where(coefficient == 0, index.dtype.type(0), index),
        coefficient=coefficient,
    )


def _without_waves(spectrum: Spectrum) -> Spectrum:
    return replace(
        static(spectrum.mean, spectrum.base, spectrum.origin_s, spectrum.link),
        time_zone=spectrum.time_zone,
        calendar=spectrum.calendar,
    )


def _scale(spectrum: Spectrum) -> tuple[object, ...]:
    return spectrum.link, spectrum.origin_s, spectrum.time_zone, spectrum.calendar, spectrum.base


_WAVE = np.dtype([("gate", np.uint8), ("frequency_hz", np.float64)])


def _unite(spectra: Sequence[Spectrum]) -> tuple[NDArray[np.void], NDArray[np.int64]]:
    """The sorted union of the wave tables and where each wave of each table went."""
    tables = [each.frequency_hz.tobytes() + each.gate.tobytes() for each in spectra]
    # Many chunks have the same table: only what differs is sorted.
    different = dict(zip(tables, spectra, strict=True))
    every = np.empty(sum(each.n_waves for each in different.values()), _WAVE)
    every["frequency_hz"] = np.concatenate([each.frequency_hz for each in different.values()])
    every["gate"] = np.concatenate([each.gate for each in different.values()])
    waves, inverse = np.unique(every, return_inverse=True)
    parts = np.split(inverse, np.cumsum([each.n_waves for each in different.values()])[:-1])
    went = dict(zip(different, parts, strict=True))
    return waves, np.concatenate([went[table] for table in tables])


def _pad(array: NDArray[Any], order: int) -> NDArray[Any]:
    if array.shape[1] == order:
        return array
    return np.pad(array, ((0, 0), (0, order - array.shape[1])))

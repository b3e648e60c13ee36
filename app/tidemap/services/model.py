"""The model of one cell, as the paper writes it: spectrum P, outliers O, and what they cost."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tidemap.history.history import History
from tidemap.history.intervals import Intervals
from tidemap.services.context import Context
from tidemap.services.history import read_cell, window
from tidemap.services.locations import find_location
from tidemap.services.parts import Cells
from tidemap.services.predict import check_cell
from tidemap.services.spectra import fitted
from tidemap.spectral.evaluation import accuracy
from tidemap.spectral.outliers import Outliers, count, find_outliers
from tidemap.spectral.spectrum import Spectrum, select
from tidemap.storage.records import LocationRecord, RevisionRecord


@dataclass(frozen=True, slots=True)
class CellCost:
    """What the history and the spectrum of a cell cost in bytes; `raw_bytes` is one bit a sample."""

    samples: int
    raw_bytes: int
    history_bytes: int
    spectrum_bytes: int
    outlier_bytes: int

    @property
    def lossy_ratio(self) -> float:
        """How much smaller the spectrum alone is."""
        return self.raw_bytes / self.spectrum_bytes

    @property
    def lossless_ratio(self) -> float:
        """How much smaller what is stored is."""
        return self.raw_bytes / max(1, self.history_bytes)

    @property
    def paper_lossless_ratio(self) -> float:
        """How much smaller the paper's form is, spectrum and outliers."""
        return self.raw_bytes / (self.spectrum_bytes + self.outlier_bytes)


@dataclass(frozen=True, slots=True, eq=False)
class CellModel:
    """Spectrum P, of this cell alone, and outliers O of a cell: outliers (n, 2) are Unix seconds [start, stop).

    `accuracy` is None where nothing was observed.
    """

    cell: int
    location: LocationRecord
    revision: RevisionRecord
    spectrum: Spectrum
    outliers: NDArray[np.float64]
    accuracy: float | None
    cost: CellCost


def model_of(ctx: Context, name: str, cell: int = 0, order: int | None = None) -> CellModel:
    """Spectrum and outliers of a cell, at another order where asked (nothing is stored).

    Raises LocationNotFoundError, NoModelError, CellNotFoundError, CorruptChunkError.
    """
    check_cell(find_location(ctx, name), cell)
    fit = fitted(ctx, name, None, order, part=Cells(np.array([cell])))
    location = fit.location
    fit.check_readable([cell])
    history = read_cell(ctx, location, cell, *window(ctx, location))
    spectrum = select(fit.spectrum, fit.rows(np.array([cell])))
    outliers = find_outliers(spectrum, history, location.base)
    return CellModel(
        cell=cell,
        location=location,
        revision=fit.revision,
        spectrum=spectrum,
        outliers=location.base.time(np.stack([outliers.start, outliers.stop], axis=1)),
        accuracy=accuracy(int(count(outliers)[0]), int(history.count_observed()[0])),
        cost=_cost(history, spectrum, outliers),
    )


def _cost(history: History, spectrum: Spectrum, outliers: Outliers) -> CellCost:
    waves = (spectrum.coefficient, spectrum.index, spectrum.frequency_hz)
    return CellCost(
        samples=history.n_samples,
        raw_bytes=-(-history.n_samples // 8),
        history_bytes=run_length_bytes(history.intervals()),
        spectrum_bytes=spectrum.mean.nbytes + sum(array.nbytes for array in waves),
        outlier_bytes=varint_bytes(_steps(outliers, history.start)),
    )


def run_length_bytes(intervals: Intervals) -> int:
    """Bytes of a Δ-encoded history: the length of every run, its state in the two lowest bits, as varints."""
    return varint_bytes((intervals.stop - intervals.start) * 4)


def _steps(outliers: Outliers, start: int) -> NDArray[np.int64]:
    """The limits t0, t1, t2 … of the outlier set as differences."""
    limits = np.stack([outliers.start, outliers.stop], axis=1).ravel()
    return np.asarray(np.diff(limits, prepend=start), np.int64)


def varint_bytes(values: Iterable[int] | NDArray[np.int64]) -> int:
    """Bytes of non-negative integers as LEB128, seven bits a byte.

    >>> varint_bytes([0, 127, 128])
    4
    """
    array = np.asarray(values, np.int64)
    return int(np.maximum(1, -(-_bit_length(array) // 7)).sum())


def _bit_length(values: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.asarray(np.frexp(values.astype(np.float64))[1], np.int64)

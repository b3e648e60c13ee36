"""The model of one cell, as the paper writes it: spectrum P, outliers O, and what they cost."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from tidemap.history.history import History
from tidemap.history.intervals import Intervals
from tidemap.schemas.maps import Component, Compression, Model, Selection
from tidemap.services.context import Context
from tidemap.services.history import read_cell, window
from tidemap.services.predict import check_cell
from tidemap.services.spectra import Fitted, fitted
from tidemap.spectral.outliers import Outliers, count, find_outliers
from tidemap.spectral.spectrum import WEEKEND, Spectrum, components, select
from tidemap.storage.records import LocationRecord


def model_of(ctx: Context, name: str, cell: int = 0, order: int | None = None) -> Model:
    """Spectrum and outliers of a cell, at another order where asked (nothing is stored).

    Raises LocationNotFoundError, NoModelError, CellNotFoundError, CorruptChunkError.
    """
    fit = fitted(ctx, name, None, order)
    location = fit.location
    check_cell(location, cell)
    fit.check_readable([cell])
    history = read_cell(ctx, location, cell, *window(ctx, location))
    spectrum = select(fit.spectrum, np.array([cell]))
    outliers = find_outliers(spectrum, history, location.base)
    observed = int(history.count_observed()[0])
    return Model(
        cell=cell,
        estimator=fit.revision.estimator,
        link=spectrum.link,
        time_zone=spectrum.time_zone,
        order=fit.revision.order,
        start=float(location.base.time(fit.revision.start)),
        stop=float(location.base.time(fit.revision.stop)),
        samples=fit.revision.stop - fit.revision.start,
        interval_s=location.interval_s,
        mean=None if np.isnan(spectrum.mean[0]) else float(spectrum.mean[0]),
        components=_components(spectrum),
        outliers=_times(location, outliers),
        accuracy=1 - int(count(outliers)[0]) / observed if observed else None,
        compression=_compression(history, spectrum, outliers),
        selection=_selection(fit),
        revision=fit.revision.revision,
    )


def _components(spectrum: Spectrum) -> list[Component]:
    table = components(spectrum, 0)
    rows = zip(table.amplitude, table.phase, table.frequency_hz, table.gate, strict=True)
    return [
        Component(
            amplitude=float(amplitude),
            phase=float(phase),
            frequency_hz=float(frequency),
            period_s=float(1 / frequency) if frequency else None,
            gate="weekend" if gate == WEEKEND else None,
        )
        for amplitude, phase, frequency, gate in rows
    ]


def _times(location: LocationRecord, outliers: Outliers) -> list[tuple[float, float]]:
    start, stop = location.base.time(outliers.start), location.base.time(outliers.stop)
    return list(zip(start.tolist(), stop.tolist(), strict=True))


def _selection(fit: Fitted) -> Selection | None:
    return None if fit.revision.selection is None else Selection(**fit.revision.selection)


def _compression(history: History, spectrum: Spectrum, outliers: Outliers) -> Compression:
    raw = -(-history.n_samples // 8)
    waves = (spectrum.coefficient, spectrum.index, spectrum.frequency_hz)
    spectrum_bytes = spectrum.mean.nbytes + sum(array.nbytes for array in waves)
    history_bytes = run_length_bytes(history.intervals())
    outlier_bytes = varint_bytes(_steps(outliers, history.start))
    return Compression(
        samples=history.n_samples,
        raw_bytes=raw,
        history_bytes=history_bytes,
        spectrum_bytes=spectrum_bytes,
        outlier_bytes=outlier_bytes,
        lossy_ratio=raw / spectrum_bytes,
        lossless_ratio=raw / max(1, history_bytes),
        paper_lossless_ratio=raw / (spectrum_bytes + outlier_bytes),
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

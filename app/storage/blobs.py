"""The stored forms of measurements, spectra and cell lists, built on `codec`."""

from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from app.spectral.history import History
from app.spectral.measurements import Measurements
from app.spectral.segment import SEGMENT_SAMPLES, Segment
from app.spectral.spectrum import Spectrum
from app.storage.codec import seal, unseal

_SPECTRUM = ("frequency_hz", "gate", "mean", "cell", "index", "coefficient")
"""The arrays of a spectrum."""


def pack_measurements(measurements: Measurements) -> bytes:
    """Sorted by time; times as runs of equal times, cells as differences, states as bits."""
    if not (measurements.time[1:] >= measurements.time[:-1]).all():
        measurements = measurements.select(np.argsort(measurements.time, kind="stable"))
    heads = measurements.heads()
    return seal(
        {
            "time": measurements.time[heads],
            "run": np.diff(heads, append=len(measurements)).astype(np.uint32),
            "cell": np.diff(measurements.cell, prepend=np.uint32(0)).view(np.int32),
            "state": np.packbits(measurements.state, bitorder="little"),
        }
    )


def unpack_measurements(blob: bytes, what: str) -> Measurements:
    """The inverse of `pack_measurements`, up to the order of rows."""
    columns = cast(dict[str, Any], unseal(blob, what, "time", "run", "cell", "state"))
    time = np.repeat(columns["time"], columns["run"])
    cell = np.cumsum(columns["cell"], dtype=np.int64).astype(np.uint32)
    state = np.unpackbits(columns["state"], count=len(time), bitorder="little")
    return Measurements(time, cell, state)


def pack_spectrum(spectrum: Spectrum) -> bytes:
    """All arrays of the spectrum and its scalars."""
    return seal(
        {
            "link": np.array(spectrum.link.encode()),
            "origin_s": np.array(spectrum.origin_s),
            "time_zone": np.array((spectrum.time_zone or "").encode()),
            **{name: getattr(spectrum, name) for name in _SPECTRUM},
        }
    )


def unpack_spectrum(blob: bytes, what: str) -> Spectrum:
    """The inverse of `pack_spectrum`."""
    columns = cast(dict[str, Any], unseal(blob, what, *_SPECTRUM, "link", "origin_s", "time_zone"))
    return Spectrum(
        link=columns["link"].item().decode(),
        origin_s=columns["origin_s"].item(),
        time_zone=columns["time_zone"].item().decode() or None,
        **{name: columns[name] for name in _SPECTRUM},
    )


def pack_cells(cells: NDArray[np.generic]) -> bytes:
    """A list of cells."""
    return seal({"cell": cells.astype(np.uint32)})


def unpack_cells(blob: bytes, what: str) -> NDArray[np.int64]:
    """The inverse of `pack_cells`."""
    return unseal(blob, what, "cell")["cell"].astype(np.int64)


def pack_segment(segment: Segment) -> bytes:
    """Bit planes, the times as differences of their bit patterns (exact), and ranks in the least width."""
    bits = segment.time.view(np.int64)
    columns: dict[str, NDArray[np.generic]] = {
        "observed": segment.history.observed,
        "occupied": segment.history.occupied,
        "time": np.diff(bits, prepend=np.int64(0)),
    }
    if segment.rank is not None:
        narrow = segment.rank.max(initial=0) < 256
        columns["rank"] = segment.rank.astype(np.uint8 if narrow else np.uint16)
    return seal(columns)


def unpack_segment(blob: bytes, number: int, what: str) -> Segment:
    """The inverse of `pack_segment`, for the segment of this number."""
    columns = cast(dict[str, Any], unseal(blob, what, "observed", "occupied", "time"))
    history = History(number * SEGMENT_SAMPLES, SEGMENT_SAMPLES, columns["observed"], columns["occupied"])
    time = np.cumsum(columns["time"]).view(np.float64)
    rank = columns.get("rank")
    return Segment(history, time, None if rank is None else rank.astype(np.uint16))

"""The stored forms of measurements, spectra, cell lists and JSON, built on `codec`."""

import json
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import CorruptChunkError
from tidemap.history.ends import Ends
from tidemap.history.history import OCCUPIED, History
from tidemap.history.measurements import UNAVAILABLE, Measurements
from tidemap.history.patterns import distinct, fill_unobserved, transpose
from tidemap.history.segment import SEGMENT_SAMPLES, Segment
from tidemap.history.snapshot import plane_cells, seen_plane
from tidemap.history.timebase import TimeBase
from tidemap.spectral.spectrum import Spectrum
from tidemap.storage.codec import QUICK, SMALL, VERSION, seal, unseal

_SPECTRUM = ("frequency_hz", "gate", "mean", "cell", "index", "coefficient")
"""The arrays of a spectrum."""
LINE = 2
"""Numbers that a line is given by."""


def pack_measurements(measurements: Measurements) -> bytes:
    """Times as runs of equal times, cells as steps from the first of their run, states as bits, and which are
    UNAVAILABLE, where some are.

    Any order comes back as it was; in order (`Measurements.in_order`) the steps are small and so is the blob. Of a
    snapshot that saw most cells of some part, which they are, in bits.
    """
    heads, cell = measurements.heads, measurements.cell
    columns: dict[str, NDArray[np.generic]] = {
        "time": measurements.time[heads],
        "first": cell[heads],
        "state": np.packbits(measurements.state == OCCUPIED, bitorder="little"),
    }
    says = measurements.says()
    if not says.all():
        columns["unavailable"] = np.packbits(~says, bitorder="little")
    seen = seen_plane(cell) if len(heads) == 1 else None
    if seen is not None:
        return seal(columns | {"run": np.array([len(cell)], np.uint32), "seen": seen})
    step = np.diff(cell, prepend=np.uint32(0))
    step[heads] = 0
    return seal(columns | {"run": np.diff(heads, append=len(cell)).astype(np.uint32), "step": narrow(step)})


def narrow(values: NDArray[np.integer[Any]]) -> NDArray[np.unsignedinteger[Any]]:
    """As the narrowest unsigned type that holds all of them."""
    return values.astype(np.min_scalar_type(values.max(initial=0)))


def unpack_measurements(blob: bytes, what: str) -> Measurements:
    """The inverse of `pack_measurements`. Raises CorruptChunkError."""
    columns = cast(dict[str, Any], unseal(blob, what, "time", "run", "first", "state"))
    run = columns["run"]
    time = _repeated(columns["time"], run)
    state = np.unpackbits(columns["state"], count=len(time), bitorder="little")
    if "unavailable" in columns:
        state[np.unpackbits(columns["unavailable"], count=len(time), bitorder="little") > 0] = UNAVAILABLE
    return Measurements(time, _cells(columns, run, what), state)


def _cells(columns: dict[str, Any], run: NDArray[np.uint32], what: str) -> NDArray[np.uint32]:
    """The cell of every measurement, which are in runs of this length. Raises CorruptChunkError."""
    if "step" in columns:
        return _summed(columns["step"], columns["first"], run)
    if "seen" not in columns:
        raise CorruptChunkError(what, "it is of another kind, without step or seen")
    try:
        return plane_cells(columns["seen"], int(columns["first"][0]), int(run[0]))
    except ValueError as error:
        raise CorruptChunkError(what, str(error)) from error


def _summed(step: NDArray[np.uint32], first: NDArray[np.uint32], run: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Cells from their steps; sums that grow past 32 bits wrap around, and so come out right."""
    cell = np.cumsum(step, dtype=np.uint32)
    off = first - cell[np.cumsum(run, dtype=np.int64) - run]
    cell += off if len(run) == 1 else np.repeat(off, run)
    return cell


def _repeated(time: NDArray[np.float64], run: NDArray[np.uint32]) -> NDArray[np.float64]:
    """The time of every measurement; a single time, which most posts have, takes no memory for each of them."""
    return np.repeat(time, run) if len(run) != 1 else np.broadcast_to(time.copy(), int(run[0]))


def pack_spectrum(spectrum: Spectrum) -> bytes:
    """All arrays of the spectrum and its scalars; the time base is its location's."""
    return seal(
        {
            "link": np.array(spectrum.link.encode()),
            "origin_s": np.array(spectrum.origin_s),
            "time_zone": np.array((spectrum.time_zone or "").encode()),
            **({"calendar": np.array(spectrum.calendar.encode())} if spectrum.calendar else {}),
            **{name: getattr(spectrum, name) for name in _SPECTRUM},
        },
        SMALL,
    )


def unpack_spectrum(blob: bytes, what: str, base: TimeBase) -> Spectrum:
    """The inverse of `pack_spectrum`, for a location with this time base."""
    columns = cast(dict[str, Any], unseal(blob, what, *_SPECTRUM, "link", "origin_s", "time_zone"))
    return Spectrum(
        link=columns["link"].item().decode(),
        origin_s=columns["origin_s"].item(),
        time_zone=columns["time_zone"].item().decode() or None,
        **{name: columns[name] for name in _SPECTRUM},
        base=base,
        calendar=columns["calendar"].item().decode() if "calendar" in columns else None,
    )


def pack_event(cells: NDArray[np.generic], seen: NDArray[np.uint8] | None) -> bytes:
    """The cells of an event and what each was seen as, where that differs."""
    columns: dict[str, NDArray[np.generic]] = {"cell": cells.astype(np.uint32)}
    return seal(columns if seen is None else columns | {"seen": seen})


def unpack_event(blob: bytes, what: str) -> tuple[NDArray[np.int64], NDArray[np.uint8] | None]:
    """The inverse of `pack_event`. Raises CorruptChunkError."""
    columns = cast(dict[str, Any], unseal(blob, what, "cell"))
    cells, seen = columns["cell"].astype(np.int64), columns.get("seen")
    if seen is not None and len(seen) != len(cells):
        raise CorruptChunkError(what, f"it says of {len(seen)} cells what they were, and has {len(cells)}")
    return cells, seen


def pack_scan(points: NDArray[np.float32], header: Any) -> bytes:
    """The points (n, 3) of a scan, and what was said of it as plain JSON."""
    return seal({"points": points.astype("<f4", copy=False), "header": np.array(json.dumps(header).encode())})


def unpack_scan(blob: bytes, what: str) -> tuple[NDArray[np.float32], Any]:
    """The inverse of `pack_scan`. Raises CorruptChunkError."""
    columns = cast(dict[str, Any], unseal(blob, what, "points", "header"))
    return columns["points"], json.loads(columns["header"].item())


def pack_numbers(interval: NDArray[np.int64]) -> bytes:
    """Numbers (n,), ascending and distinct, near each other: of intervals in which something was heard, of chunks."""
    first = interval[:1]
    bits = np.zeros(int(interval[-1] - first[0]) + 1 if len(interval) else 0, np.bool_)
    bits[interval - first] = True
    return seal({"first": first, "heard": np.packbits(bits)}, SMALL)


def unpack_numbers(blob: bytes, what: str) -> NDArray[np.int64]:
    """The inverse of `pack_numbers`. Raises CorruptChunkError."""
    columns = cast(dict[str, Any], unseal(blob, what, "first", "heard"))
    found = np.flatnonzero(np.unpackbits(columns["heard"]))
    return found + columns["first"][0] if len(found) else found


def pack_json(value: Any, version: int = VERSION) -> bytes:
    """A value of plain JSON; version: the first that understands it."""
    return seal({"json": np.array(json.dumps(value).encode())}, SMALL, version)


def unpack_json(blob: bytes, what: str, latest: int = VERSION) -> Any:
    """The inverse of `pack_json`, of a version up to `latest`. Raises CorruptChunkError."""
    return json.loads(cast(Any, unseal(blob, what, "json", latest=latest)["json"]).item())


def pack_segment(segment: Segment) -> bytes:
    """What repeats is stored once: of the observed plane the distinct rows of cells, and of those the distinct samples.

    What a robot sees from one location are always the same cells. The occupied plane is told by a state that stands
    until another is observed, so that cells which alike are always free are alike, whenever they were observed.
    ValueError where something is occupied that was not observed: that has no stored form.
    """
    history = segment.history.check()
    rows, row = distinct(history.observed)
    seen, sample = distinct(transpose(rows))
    state, stands = distinct(fill_unobserved(history.observed, history.occupied))
    columns: dict[str, NDArray[np.generic]] = {
        "seen": seen,
        "sample": narrow(sample),
        "row": narrow(row),
        "state": state,
        "stands": narrow(stands),
        "time": _off_line(segment.time, _locations(seen, sample, len(segment.time))),
    }
    if segment.rank is not None:
        columns["rank"] = narrow(segment.rank)
    if segment.surplus is not None:
        columns["surplus"] = narrow(np.where(segment.surplus < 0, -2 * segment.surplus - 1, 2 * segment.surplus))
    if segment.ends is not None:
        columns |= {"end_cell": narrow(segment.ends.cell), "end_time": segment.ends.time}
    # Ranks, which differ from cell to cell, get no smaller by trying harder, and take ten times as long.
    return seal(columns, SMALL if segment.rank is None else QUICK)


def unpack_segment(blob: bytes, number: int, what: str) -> Segment:
    """The inverse of `pack_segment`, for the segment of this number."""
    columns = cast(dict[str, Any], unseal(blob, what, "seen", "sample", "row", "state", "stands", "time"))
    seen, sample, row = columns["seen"], columns["sample"], columns["row"]
    observed = transpose(seen[sample])[row]
    occupied = columns["state"][columns["stands"]]
    occupied &= observed
    off = columns["time"]
    time = _on_line(off, _locations(seen, sample, max(0, len(off) - LINE)))
    rank, surplus = columns.get("rank"), columns.get("surplus")
    history = History(number * SEGMENT_SAMPLES, SEGMENT_SAMPLES, observed, occupied)
    return Segment(
        history,
        time,
        None if rank is None else rank.astype(np.uint16),
        None if surplus is None else _signed(surplus),
        Ends(columns["end_cell"].astype(np.uint32), columns["end_time"]) if "end_cell" in columns else None,
    )


def observed_counts(blob: bytes, what: str) -> NDArray[np.int64]:
    """(SEGMENT_SAMPLES,) how many cells of a packed segment were observed in each sample. Raises CorruptChunkError.

    Of distinct rows and samples alone, which is some ten times faster than to unpack them.
    """
    columns = cast(dict[str, Any], unseal(blob, what, "seen", "sample", "row"))
    seen = np.unpackbits(columns["seen"], axis=1, bitorder="little")
    alike = np.bincount(columns["row"], minlength=seen.shape[1])
    counts: NDArray[np.int64] = (seen @ alike)[columns["sample"]]
    return counts


def _signed(folded: NDArray[np.unsignedinteger[Any]]) -> NDArray[np.int32]:
    """Whole numbers that are stored as 0, -1, 1, -2, … of 0, 1, 2, 3, …"""
    half = (folded >> 1).astype(np.int32)
    return np.where(folded & 1, -half - 1, half)


def _locations(seen: NDArray[np.uint8], sample: NDArray[Any], n_times: int) -> NDArray[np.int64]:
    """Where on their line the times are expected: at the observed samples, one after the other if some hold several."""
    observed = np.flatnonzero(np.any(seen, axis=1).take(sample))
    return observed if len(observed) == n_times else np.arange(n_times)


def _off_line(time: NDArray[np.float64], at: NDArray[np.int64]) -> NDArray[np.int64]:
    """First time, slope, and how far the bits of each are from those of that line: zeros for times at their samples."""
    slope = (time[-1:] - time[:1]) / np.maximum(at[-1:] - at[:1], 1)
    line = time[:1] + slope * (at - at[:1])
    # Differences of bit patterns are exact, also where they wrap around.
    return np.concatenate([time[:1].view(np.int64), slope.view(np.int64), time.view(np.int64) - line.view(np.int64)])


def _on_line(off: NDArray[np.int64], at: NDArray[np.int64]) -> NDArray[np.float64]:
    """The inverse of `_off_line`."""
    first, slope = off[:1].view(np.float64), off[1:LINE].view(np.float64)
    return (off[LINE:] + (first + slope * (at - at[:1])).view(np.int64)).view(np.float64)

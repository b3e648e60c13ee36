"""What is stored comes back exactly, and what is damaged never comes back as something else."""

from collections.abc import Callable
from random import Random
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tidemap.errors import CorruptChunkError
from tidemap.history.history import History
from tidemap.history.measurements import Measurements
from tidemap.history.segment import SEGMENT_SAMPLES, Segment
from tidemap.history.timebase import TimeBase
from tidemap.spectral.spectrum import Spectrum
from tidemap.storage.blobs import (
    pack_event,
    pack_measurements,
    pack_segment,
    pack_spectrum,
    unpack_event,
    unpack_measurements,
    unpack_segment,
    unpack_spectrum,
)
from tidemap.storage.codec import VERSION, seal, unseal

BASE = TimeBase(0.0, 60.0)
quick = settings(max_examples=60)
DTYPES = st.sampled_from(["u1", "<u2", "<u4", "<i4", "<i8", "<f4", "<f8", "<c8", "?", "S3"])
COLUMNS = st.dictionaries(
    st.text(max_size=8),
    DTYPES.flatmap(
        lambda dtype: hnp.arrays(np.dtype(dtype), hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=5))
    ),
    max_size=4,
)
TIMES = st.floats(-1e11, 1e11)
ROWS = st.lists(
    st.tuples(st.sampled_from([0.0, -0.25, 1.5e9, 1.5e9 + 1e-6]) | TIMES, st.integers(0, 2**31 - 1), st.integers(0, 1))
)


def bits_of(array: np.ndarray) -> tuple[str, tuple[int, ...], bytes]:
    """An array to the last bit: NaN equals itself, -0.0 is not 0.0."""
    return array.dtype.str, array.shape, array.tobytes()


@quick
@given(COLUMNS)
def test_sealed_columns_come_back(columns: dict[str, np.ndarray]) -> None:
    found = unseal(seal(columns), "test")
    assert list(found) == list(columns)
    assert {name: bits_of(column) for name, column in found.items()} == {
        name: bits_of(column) for name, column in columns.items()
    }


@quick
@given(hnp.arrays(np.int32, (3, 4)))
def test_the_layout_in_memory_does_not_matter(array: np.ndarray) -> None:
    for same in (np.asfortranarray(array), np.repeat(array, 2, axis=1)[:, ::2], array[::-1][::-1]):
        assert seal({"a": same}) == seal({"a": array})


@quick
@given(ROWS)
def test_measurements_come_back(rows: list[tuple[float, int, int]]) -> None:
    time, cell, state = (np.array(column) for column in zip(*rows, strict=True)) if rows else (np.empty(0),) * 3
    packed = Measurements(time.astype(float), cell.astype(np.uint32), state.astype(np.uint8))
    found = unpack_measurements(pack_measurements(packed), "test")
    dtypes = [column.dtype for column in (found.time, found.cell, found.state)]
    assert dtypes == [np.dtype(wanted) for wanted in (np.float64, np.uint32, np.uint8)]
    unpacked = list(zip(found.time.tolist(), found.cell.tolist(), found.state.tolist(), strict=True))
    assert unpacked == rows


@quick
@given(st.sets(st.integers(0, 60)), st.sampled_from([0, 9, 2**32 - 61]), st.randoms(use_true_random=False))
def test_a_look_comes_back_from_a_bit_a_cell(cells: set[int], first: int, random: Random) -> None:
    """Those of ascending cells that are no more than eight times as far apart as they are many."""
    cell = np.array(sorted(cells), np.int64) + first
    state = np.array([random.randint(0, 1) for _ in cell], np.uint8)
    look = Measurements(np.full(len(cell), 7.5), cell.astype(np.uint32), state)
    blob = pack_measurements(look)
    dense = bool(cells) and max(cells) - min(cells) < 8 * len(cells)
    assert ("seen" in unseal(blob, "test"), "step" in unseal(blob, "test")) == (dense, not dense)
    found = unpack_measurements(blob, "test")
    assert (found.cell.tolist(), found.state.tolist()) == (cell.tolist(), state.tolist())


def test_a_look_whose_bits_are_not_as_many_as_its_measurements_is_corrupt() -> None:
    look = Measurements(np.full(3, 7.5), np.array([3, 4, 6], np.uint32), np.ones(3, np.uint8))
    columns = unseal(pack_measurements(look), "test")
    for run in (2, 4):
        with pytest.raises(CorruptChunkError, match=f"has other than {run} cells"):
            unpack_measurements(seal({**columns, "run": np.array([run], np.uint32)}), "observation 7")


@st.composite
def segments(draw: st.DrawFn) -> Segment:
    """Any planes that do not contradict each other, times and ranks, also such as no merge makes."""
    n_cells = draw(st.integers(1, 20))
    plane = hnp.arrays(np.uint8, (n_cells, SEGMENT_SAMPLES // 8), elements=st.integers(0, 255), fill=st.just(0))
    observed = draw(plane)
    history = History(3 * SEGMENT_SAMPLES, SEGMENT_SAMPLES, observed, observed & draw(plane))
    time = np.array(sorted(draw(st.lists(TIMES, max_size=9))), np.float64)
    top = draw(st.sampled_from([0, 255, 65535]))
    rank = hnp.arrays(np.uint16, (n_cells, SEGMENT_SAMPLES), elements=st.integers(0, top), fill=st.just(0))
    return Segment(history, time, draw(st.none() | rank))


@quick
@given(segments())
def test_segments_come_back(segment: Segment) -> None:
    found = unpack_segment(pack_segment(segment), 3, "test")
    assert (found.history.start, found.history.n_samples) == (3 * SEGMENT_SAMPLES, SEGMENT_SAMPLES)
    pairs: list[tuple[np.ndarray, np.ndarray]] = [
        (segment.history.observed, found.history.observed),
        (segment.history.occupied, found.history.occupied),
        (segment.time, found.time),
    ]
    assert (segment.rank is None) == (found.rank is None)
    if segment.rank is not None and found.rank is not None:
        pairs.append((segment.rank, found.rank))
    for stored, read in pairs:
        assert bits_of(stored) == bits_of(read)


def test_what_is_occupied_but_was_not_observed_is_not_stored() -> None:
    free, full = (np.full((1, SEGMENT_SAMPLES // 8), byte, np.uint8) for byte in (0, 255))
    with pytest.raises(ValueError, match="occupied where nothing was observed"):
        pack_segment(Segment(History(0, SEGMENT_SAMPLES, free, full), np.empty(0), None))


@st.composite
def spectra(draw: st.DrawFn) -> Spectrum:
    n_cells, order = draw(st.integers(1, 6)), draw(st.integers(0, 3))
    cell = sorted(draw(st.sets(st.integers(0, n_cells - 1)))) if order else []
    n_waves = draw(st.integers(1, 5)) if cell else 0
    width = draw(st.sampled_from([np.uint16, np.uint32]))
    return Spectrum(
        link=draw(st.sampled_from(["identity", "logit"])),
        origin_s=draw(TIMES),
        time_zone=draw(st.sampled_from([None, "UTC", "Europe/London"])),
        frequency_hz=draw(hnp.arrays(np.float64, n_waves)),
        gate=draw(hnp.arrays(np.uint8, n_waves)),
        mean=draw(hnp.arrays(np.float32, n_cells)),
        cell=np.array(cell, np.int32),
        index=draw(hnp.arrays(width, (len(cell), order), elements=st.integers(0, max(0, n_waves - 1)))),
        coefficient=draw(hnp.arrays(np.complex64, (len(cell), order))),
        base=BASE,
    )


@quick
@given(spectra())
def test_spectra_come_back(spectrum: Spectrum) -> None:
    found = unpack_spectrum(pack_spectrum(spectrum), "test", BASE)
    assert (found.link, found.origin_s, found.time_zone) == (spectrum.link, spectrum.origin_s, spectrum.time_zone)
    assert found.base == BASE
    for name in ("frequency_hz", "gate", "mean", "cell", "index", "coefficient"):
        assert bits_of(getattr(found, name)) == bits_of(getattr(spectrum, name)), name


@quick
@given(st.dictionaries(st.integers(0, 2**32 - 1), st.integers(1, 3)))
def test_events_come_back(seen: dict[int, int]) -> None:
    cells, bits = np.array(list(seen), np.int64), np.array(list(seen.values()), np.uint8)
    found, bits_found = unpack_event(pack_event(cells, bits), "test")
    assert bits_found is not None
    assert dict(zip(found.tolist(), bits_found.tolist(), strict=True)) == seen
    alike, none = unpack_event(pack_event(cells, None), "test")
    assert (alike.tolist(), none) == (cells.tolist(), None)


SAMPLE_SEGMENT = Segment(History.from_states(np.eye(3, SEGMENT_SAMPLES, dtype=np.uint8)), np.array([0.5]), None)
SAMPLE_SPECTRUM = Spectrum(
    "identity",
    0.0,
    None,
    np.array([0.5]),
    np.zeros(1, np.uint8),
    np.array([0.5, np.nan], np.float32),
    np.array([1], np.int32),
    np.zeros((1, 1), np.uint16),
    np.ones((1, 1), np.complex64),
    BASE,
)
BLOBS: dict[str, tuple[bytes, Callable[[bytes], Any]]] = {
    "cells": (pack_event(np.arange(9), None), lambda blob: unpack_event(blob, "cells of anomaly 7")),
    "look": (
        pack_measurements(Measurements(np.zeros(2), np.array([3, 4], np.uint32), np.array([0, 1], np.uint8))),
        lambda blob: unpack_measurements(blob, "observation 7"),
    ),
    "measurements": (
        pack_measurements(Measurements(np.array([1.0, 2.0]), np.array([3, 4], np.uint32), np.array([0, 1], np.uint8))),
        lambda blob: unpack_measurements(blob, "observation 7"),
    ),
    "segment": (pack_segment(SAMPLE_SEGMENT), lambda blob: unpack_segment(blob, 0, "history of 'lab', chunk 7")),
    "spectrum": (
        pack_spectrum(SAMPLE_SPECTRUM),
        lambda blob: unpack_spectrum(blob, "spectrum of 'lab', chunk 7", BASE),
    ),
}
every_blob = pytest.mark.parametrize(("blob", "unpack"), BLOBS.values(), ids=BLOBS)


@every_blob
def test_any_flipped_bit_is_noticed_and_the_blob_named(blob: bytes, unpack: Callable[[bytes], Any]) -> None:
    unpack(blob)
    for position in range(len(blob)):
        for bit in (1, 128):
            damaged = bytearray(blob)
            damaged[position] ^= bit
            with pytest.raises(CorruptChunkError, match=r"7 is corrupt: .* Restore it from a backup"):
                unpack(bytes(damaged))


@every_blob
def test_a_blob_that_is_cut_short_or_goes_on_is_noticed(blob: bytes, unpack: Callable[[bytes], Any]) -> None:
    for damaged in (*(blob[:length] for length in range(len(blob))), blob + b"\0", blob + blob):
        with pytest.raises(CorruptChunkError, match="7 is corrupt"):
            unpack(damaged)


@every_blob
def test_the_format_of_another_version_is_refused(blob: bytes, unpack: Callable[[bytes], Any]) -> None:
    with pytest.raises(CorruptChunkError, match=f"its format is {VERSION + 1}, this version reads {VERSION}"):
        unpack(bytes([VERSION + 1]) + blob[1:])


@pytest.mark.parametrize("name", ["look", "measurements", "segment", "spectrum"])
def test_a_blob_of_another_kind_is_refused(name: str) -> None:
    _, unpack = BLOBS[name]
    for other, (blob, _) in BLOBS.items():
        if other != name and {name, other} != {"look", "measurements"}:
            with pytest.raises(CorruptChunkError, match="7 is corrupt"):
                unpack(blob)


def test_what_is_read_cannot_be_written_to() -> None:
    column = unseal(seal({"a": np.arange(3)}), "test")["a"]
    with pytest.raises(ValueError, match="read-only"):
        column[0] = 1


def test_blobs_are_the_same_on_every_machine() -> None:
    """Big-endian arrays keep their order of bytes in the header, so that either machine reads them."""
    found = unseal(seal({"a": np.arange(3, dtype=">i4")}), "test")["a"]
    assert found.tolist() == [0, 1, 2]

"""Observations that are refused, whole, with the field that is wrong and what to change."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from tests.api.house import ARROW, DAY, HOUR, NOW, NPY, arrow, arrow_table, npy, npy_file
from tests.api.refusals import (
    DOOR,
    INFINITY,
    LAB,
    NAN,
    Case,
    T,
    Untouched,
    columns,
    form,
    look,
    raw,
    state,
    structured,
    table,
)


def doubled() -> bytes:
    time = pa.array([T])
    return arrow_table(pa.Table.from_arrays([time, time, pa.array([1])], names=["time", "time", "state"]))


def packed() -> bytes:
    return arrow({"time": np.zeros(10_000), "state": np.zeros(10_000, np.uint8)}, compression="zstd")


ONE = np.array([1], np.uint8)
STATES = [
    # Fields
    form(f"{DOOR}/observations", {"time": [T], "state": [1], "colour": 1}, "colour", "known are state, time"),
    form(f"{DOOR}/observations", {"state": [1]}, "time", "missing"),
    form(f"{DOOR}/observations", {"time": [T]}, "state", "missing"),
    form(f"{DOOR}/observations", {}, "state", "missing"),
    form(f"{DOOR}/observations", {"observations": [{"time": T, "occupied": [0]}]}, "observations", "known are"),
    # Lengths
    state([T, T + 60], [1], "state", "one length"),
    state([T], [1, 0], "state", "one length"),
    state([], [], "time", "at least one"),
    # Times
    state([T, NAN], [1, 0], "time[1]", "send a number"),
    state([T, INFINITY], [1, 0], "time[1]"),
    state([-INFINITY, T], [1, 0], "time[0]"),
    state(["2026-03-01T09:00:00"], [1], "time[0]", "zone"),
    state([T, "2026-03-01"], [1, 0], "time[1]", "zone"),
    *(state([text], [1], "time[0]", "a number in quotes") for text in ("2026", "0930", str(T), " 7 ", "-1.5e3")),
    *(
        state([T, text], [1, 0], "time[1]", "a date alone")
        for text in ("2026-03-01", "2026-03-01Z", "2026-03", "2026-W09")
    ),
    state(["yesterday"], [1], "time[0]", "ISO 8601"),
    state(["2026-02-30T00:00:00Z"], [1], "time[0]", "ISO 8601"),
    state([""], [1], "time[0]", "ISO 8601"),
    state([None], [1], "time[0]", "Unix seconds"),
    state([True], [1], "time[0]", "Unix seconds"),
    state([T, True], [1, 0], "time[1]", "Unix seconds"),
    state([[T]], [1], "time[0]", "Unix seconds"),
    state([{"t": T}], [1], "time[0]", "Unix seconds"),
    state("now", [1], "time", "list"),
    state(T, [1], "time", "list"),
    state([NOW + 2 * HOUR], [1], "time[0]", "future"),
    state([T * 1000], [1], "time[0]", "seconds"),
    state(["9999-12-31T23:59:59Z"], [1], "time[0]"),
    state([-1e12], [1], "time[0]", "Unix time"),
    state(["0001-01-01T00:00:00Z"], [1], "time[0]", "Unix time"),
    raw(f"{DOOR}/observations", b'{"time": [1' + b"0" * 400 + b'], "state": [1]}', 400, None, "JSON"),
    # States
    state([T], [2], "state[0]", "0 (free) or 1 (occupied)"),
    state([T, T], [0, -1], "state[1]", "0 (free) or 1 (occupied)"),
    state([T], ["1"], "state[0]", "0 (free) or 1 (occupied)"),
    state([T], [None, None], "state", "one length"),
    state([T, T], [None, 2], "state[1]", "null where the sensor is unavailable"),
    state([T, T], [None, 1], "time[1]", "both unavailable and occupied"),
    state([T], [0.5], "state[0]", "0 (free) or 1 (occupied)"),
    state([T], [1.0], "state[0]", "0 (free) or 1 (occupied)"),
    state([T], [True], "state[0]", "0 (free) or 1 (occupied)"),
    state([T], [[1]], "state[0]", "0 (free) or 1 (occupied)"),
    state([T], [NAN], "state[0]", "NaN"),
    state([T], [2**70], "state[0]"),
    state([T], [2**64 - 1], "state[0]", "0 (free) or 1 (occupied)"),
    state([T], {"0": 1}, "state", "list"),
    state([T], None, "state", "list"),
    # Contradictions
    state([T, T], [0, 1], "time[1]", "both occupied and free"),
]
CELLS = [
    form(f"{LAB}/observations", {"time": [T], "state": [1]}, "state", "known are observations"),
    form(f"{LAB}/observations", {"observations": {}}, "observations", "list"),
    form(f"{LAB}/observations", {"observations": []}, "observations", "at least one"),
    form(f"{LAB}/observations", {"observations": [[]]}, "observations[0]", "object"),
    form(f"{LAB}/observations", {"observations": [{"time": T, "free": [1]}, {"free": [1]}]}, "observations[1].time"),
    look({"time": T}, "observations", "at least one"),
    look({"time": T, "occupied": [], "free": []}, "observations", "at least one"),
    look({"time": T, "ocupied": [1]}, "observations[0].ocupied", "known are free, occupied, time, unavailable"),
    look({"time": NAN, "occupied": [1]}, "observations[0].time", "NaN"),
    look({"time": "2026-03-01T09:00", "occupied": [1]}, "observations[0].time", "zone"),
    look({"time": NOW + DAY, "occupied": [1]}, "observations[0].time", "future"),
    look({"time": "2026", "occupied": [1]}, "observations[0].time", "a number in quotes"),
    look({"time": None, "occupied": [1]}, "observations[0].time"),
    look({"time": T, "occupied": [24]}, "observations[0].occupied[0]", "0 to 23"),
    look({"time": T, "free": [0, -1]}, "observations[0].free[1]", "0 to 23"),
    look({"time": T, "free": [2**40]}, "observations[0].free[0]", "0 to 23"),
    look({"time": T, "free": [2**63]}, "observations[0].free[0]"),
    look({"time": T, "occupied": [[4, 0, 0]]}, "observations[0].occupied[0]", "0 to 23"),
    look({"time": T, "occupied": [[0, 0, 0], [0, -1, 0]]}, "observations[0].occupied[1]", "0 to 23"),
    look({"time": T, "occupied": [[0, 0]]}, "observations[0].occupied", "3 whole numbers"),
    look({"time": T, "occupied": [[0, 0, 0, 0]]}, "observations[0].occupied", "3 whole numbers"),
    look({"time": T, "occupied": [[]]}, "observations[0].occupied", "3 whole numbers"),
    look({"time": T, "occupied": [[0, 0, 0], [1, 1]]}, "observations[0].occupied", "3 whole numbers"),
    look({"time": T, "occupied": [3, [1, 1]]}, "observations[0].occupied", "3 whole numbers"),
    look({"time": T, "occupied": [[0, 0, 0], "a"]}, "observations[0].occupied[1]", "[i,j,k]"),
    look({"time": T, "occupied": [[0, 0, 0.5]]}, "observations[0].occupied", "3 whole numbers"),
    look({"time": T, "occupied": [[0, 0, True]]}, "observations[0].occupied", "3 whole numbers"),
    look({"time": T, "occupied": [[[0], 0, 0]]}, "observations[0].occupied", "3 whole numbers"),
    look({"time": T, "occupied": [1.5]}, "observations[0].occupied[0]", "[i,j,k]"),
    look({"time": T, "occupied": ["1"]}, "observations[0].occupied[0]", "[i,j,k]"),
    look({"time": T, "occupied": [None]}, "observations[0].occupied[0]", "[i,j,k]"),
    look({"time": T, "occupied": [2, True]}, "observations[0].occupied[1]", "[i,j,k]"),
    look({"time": T, "occupied": 1}, "observations[0].occupied", "list"),
    look({"time": T, "occupied": None}, "observations[0].occupied", "list"),
    look({"time": T, "occupied": [1], "free": [2, 1]}, "observations[0].free[1]", "both occupied and free"),
    look({"time": T, "occupied": [[0, 0, 1]], "free": [1]}, "observations[0].free[0]", "both occupied and free"),
    look({"time": T, "free": [2], "unavailable": [1, 2]}, "observations[0].unavailable[1]", "unavailable and free"),
    look({"time": T, "unavailable": [24]}, "observations[0].unavailable[0]", "0 to 23"),
    look({"time": T, "unavailable": None}, "observations[0].unavailable", "list"),
]
TABLES = [
    columns(DOOR, {"time": [T]}, 422, "state", "missing"),
    columns(DOOR, {"state": ONE}, 422, "time", "missing"),
    columns(DOOR, {"time": [T], "state": ONE, "robot": ["r"]}, 422, "robot", "send state, time"),
    columns(DOOR, {"time": [T], "cell": [0], "state": ONE}, 422, "cell", "send state, time"),
    columns(DOOR, doubled(), 422, "time", "twice"),
    columns(DOOR, {"time": [T, None], "state": [0, 1]}, 422, "time", "nulls"),
    columns(DOOR, {"time": [T, T + 1], "state": [None, 2]}, 422, "state[1]", "null where the sensor"),
    columns(DOOR, {"time": [T, T + 1], "state": [NAN, 0.5]}, 422, "state[1]", "null where the sensor"),
    columns(DOOR, {"time": ["2026-03-01T09:00:00Z"], "state": ONE}, 422, "time", "float64"),
    columns(DOOR, {"time": np.array([T], np.float32), "state": ONE}, 422, "time", "float64"),
    columns(DOOR, {"time": pa.array([10], pa.date32()), "state": ONE}, 422, "time", "float64"),
    columns(DOOR, {"time": pa.array([10], pa.timestamp("s")), "state": ONE}, 422, "time", "zone"),
    columns(DOOR, {"time": pa.nulls(1), "state": ONE}, 422, "time", "float64"),
    columns(DOOR, {"time": pa.array([T]).dictionary_encode(), "state": ONE}, 422, "time", "float64"),
    columns(DOOR, {"time": [[T]], "state": ONE}, 422, "time", "float64"),
    columns(DOOR, {"time": [T], "state": [1.5]}, 422, "state[0]", "0 (free) or 1 (occupied)"),
    columns(DOOR, {"time": [T], "state": ["1"]}, 422, "state", "uint8 or bool"),
    columns(DOOR, {"time": [T, NAN], "state": [0, 1]}, 422, "time[1]", "NaN"),
    columns(DOOR, {"time": [T, INFINITY], "state": [0, 1]}, 422, "time[1]", "infinity"),
    columns(DOOR, {"time": [NOW + DAY], "state": ONE}, 422, "time[0]", "future"),
    columns(DOOR, {"time": np.array([int(T * 1e9)]), "state": ONE}, 422, "time[0]", "seconds"),
    columns(DOOR, {"time": [-1e12], "state": ONE}, 422, "time[0]", "Unix time"),
    columns(DOOR, {"time": [T], "state": np.array([2], np.uint8)}, 422, "state[0]", "0 (free)"),
    columns(DOOR, {"time": [T], "state": np.array([-1], np.int8)}, 422, "state[0]", "0 (free)"),
    columns(DOOR, {"time": [T], "state": np.array([257], np.int16)}, 422, "state[0]", "0 (free)"),
    columns(DOOR, {"time": [T, T], "state": [0, 1]}, 422, "time[1]", "both"),
    columns(DOOR, {"time": pa.array([], pa.float64()), "state": pa.array([], pa.uint8())}, 422, "time", "at least one"),
    columns(DOOR, packed(), 400, None, "compression"),
    columns(DOOR, b"", 400, None, "Arrow IPC stream"),
    columns(DOOR, b"ARROW1\0\0 but not really", 400, None, "Arrow IPC stream"),
    columns(DOOR, b'{"time": [1], "state": [1]}', 400, None, "Arrow IPC stream"),
    columns(DOOR, arrow({"time": [T], "state": ONE})[:200], 400, None, "Arrow IPC stream"),
    columns(DOOR, b"\xff\xff\xff\xff" + b"\xff\xff\xff\x7f" + b"\0" * 64, 400, None, "Arrow IPC stream"),
    columns(LAB, {"time": [T], "state": ONE}, 422, "cell", "missing"),
    columns(LAB, {"time": [T], "cell": np.array([24], np.uint32), "state": ONE}, 422, "cell[0]", "0 to 23"),
    columns(LAB, {"time": [T], "cell": np.array([-1], np.int32), "state": ONE}, 422, "cell[0]", "0 to 23"),
    columns(LAB, {"time": [T], "cell": np.array([2**64 - 1], np.uint64), "state": ONE}, 422, "cell[0]", "0 to 23"),
    columns(LAB, {"time": [T], "cell": [1.0], "state": ONE}, 422, "cell", "uint32"),
    columns(LAB, {"time": [T], "cell": [[0, 0, 1]], "state": ONE}, 422, "cell", "uint32"),
    columns(LAB, {"time": [T], "cell": [True], "state": ONE}, 422, "cell", "uint32"),
    columns(LAB, {"time": [T, T], "cell": [5, 5], "state": [0, 1]}, 422, "cell[1]", "both"),
]


def headed(header: str, rows: bytes = b"", version: bytes = b"\x01\x00") -> bytes:
    """An npy file with a header as it is given."""
    text = header.encode("latin-1")
    return b"\x93NUMPY" + version + len(text).to_bytes(2, "little") + text + rows


def described(descr: str, shape: str = "(1,)", rows: bytes = b"") -> bytes:
    """An npy file with these entries in its header."""
    return headed(f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}}}", rows)


PAIR = "[('time', '<f8'), ('state', '|u1')]"
LIES = {"(-5, -3)": 15, f"(0, {2**70})": 0, str((1,) * 70): 1}
"""Shapes that no file has, and bytes of uint8 that would do."""
NPYS = [
    *(
        structured(DOOR, described(PAIR, shape, bytes(9 * n)), 400, None, "declares the shape")
        for shape, n in LIES.items()
    ),
    structured(DOOR, {"time": [T]}, 422, "state", "missing"),
    structured(DOOR, {"time": [T], "state": ONE, "robot": [1]}, 422, "robot", "send state, time"),
    structured(DOOR, {"time": [T], "cell": [0], "state": ONE}, 422, "cell", "send state, time"),
    structured(DOOR, npy_file(np.zeros((3, 2))), 422, "body", "structured array with the fields state, time"),
    structured(LAB, npy_file(np.zeros((4, 3, 2), np.uint8)), 422, "body", "?time="),
    structured(DOOR, npy_file(np.zeros((2, 2), [("time", "f8"), ("state", "u1")])), 422, "body", "shape (n,)"),
    structured(DOOR, npy_file(np.zeros((), [("time", "f8"), ("state", "u1")])), 422, "body", "shape (n,)"),
    structured(DOOR, {"time": np.array([T], np.float32), "state": ONE}, 422, "time", "float64"),
    structured(DOOR, {"time": np.array([T], np.complex128), "state": ONE}, 422, "time", "float64"),
    structured(DOOR, {"time": np.array([10], "M8[s]"), "state": ONE}, 422, "time", "float64"),
    structured(DOOR, {"time": [[T, T]], "state": ONE}, 422, "time", "float64"),
    structured(DOOR, {"time": [T], "state": [INFINITY]}, 422, "state[0]", "0 (free) or 1 (occupied)"),
    structured(DOOR, {"time": [T], "state": ["1"]}, 422, "state", "uint8 or bool"),
    structured(DOOR, {"time": [T, NAN], "state": [0, 1]}, 422, "time[1]", "NaN"),
    structured(DOOR, {"time": [T, INFINITY], "state": [0, 1]}, 422, "time[1]", "infinity"),
    structured(DOOR, {"time": [T, NOW + DAY], "state": [0, 1]}, 422, "time[1]", "future"),
    structured(DOOR, {"time": [-1e12], "state": ONE}, 422, "time[0]", "Unix time"),
    structured(DOOR, {"time": [T, T], "state": np.array([1, 2], np.uint8)}, 422, "state[1]", "0 (free)"),
    structured(DOOR, {"time": [T], "state": np.array([-1], np.int8)}, 422, "state[0]", "0 (free)"),
    structured(DOOR, described("[('time', '<f8'), ('state', '|b1')]", rows=b"\0" * 8 + b"\7"), 422, "state[0]"),
    structured(DOOR, {"time": [T, T], "state": [0, 1]}, 422, "time[1]", "both"),
    structured(DOOR, {"time": np.empty(0), "state": np.empty(0, np.uint8)}, 422, "time", "at least one"),
    structured(DOOR, b"", 400, None, "numpy.save"),
    structured(DOOR, b"\x93NUMPY", 400, None, "numpy.save"),
    structured(DOOR, b'{"time": [1], "state": [1]}', 400, None, "numpy.save"),
    structured(DOOR, npy({"time": [T], "state": ONE})[:-1], 400, None, "follow its header"),
    structured(DOOR, npy({"time": [T], "state": ONE}) + b"\0", 400, None, "follow its header"),
    structured(DOOR, described(PAIR, "(10**9,)"), 400, None, "numpy.save"),
    structured(DOOR, described(PAIR, f"({10**30},)"), 400, None, "declares the shape"),
    structured(DOOR, described(PAIR, "(-1,)"), 400, None, "declares the shape"),
    structured(DOOR, described(PAIR, "(1.5,)"), 400, None, "numpy.save"),
    structured(DOOR, described("[('time', '|O'), ('state', '|O')]", rows=b"\0" * 16), 422, "time", "float64"),
    structured(DOOR, described("'|O'"), 422, "body", "structured"),
    structured(DOOR, described("__import__('os')"), 400, None, "numpy.save"),
    structured(DOOR, described("(" * 2000), 400, None, "numpy.save"),
    structured(DOOR, headed("{}"), 400, None, "numpy.save"),
    structured(DOOR, headed("{" + " " * 60_000 + "}"), 400, None, "numpy.save"),
    structured(DOOR, headed("{}", version=b"\x03\x00"), 400, None, "numpy.save"),
    structured(DOOR, headed("{}", version=b"\xff\x00"), 400, None, "numpy.save"),
    structured(LAB, {"time": [T], "state": ONE}, 422, "cell", "missing"),
    structured(LAB, {"time": [T], "cell": np.array([24], np.uint32), "state": ONE}, 422, "cell[0]", "0 to 23"),
    structured(LAB, {"time": [T], "cell": np.array([-1], np.int32), "state": ONE}, 422, "cell[0]", "0 to 23"),
    structured(LAB, {"time": [T], "cell": [1.0], "state": ONE}, 422, "cell", "uint32"),
    structured(LAB, {"time": [T], "cell": [[0, 0, 1]], "state": ONE}, 422, "cell", "uint32"),
    structured(LAB, {"time": [T], "cell": [True], "state": ONE}, 422, "cell", "uint32"),
    structured(LAB, {"time": [T, T], "cell": [5, 5], "state": [0, 1]}, 422, "cell[1]", "both"),
]


def whole(array: Any, status: int, names: str | None, says: str = "", time: str = f"{T}", location: str = LAB) -> Case:
    content = array if isinstance(array, bytes) else npy_file(array)
    return raw(f"{location}/observations?time={time}", content, status, names, says, NPY)


FREE = np.zeros((4, 3, 2), np.uint8)
ROWS = {"time": [T], "cell": np.array([1], np.uint32), "state": ONE}
GRIDS = [
    *(whole(FREE, 422, "time", "zone", time) for time in ("2026-03-01T09:00:00", "2026-03-01")),
    *(whole(FREE, 422, "time", "", time) for time in ("", "now", "nan", "inf", "1e300", str(T * 1000))),
    whole(FREE, 422, "time", "future", str(NOW + DAY)),
    *(whole(described("'|u1'", shape, bytes(n)), 400, None, "declares the shape") for shape, n in LIES.items()),
    whole(npy(ROWS), 422, "time", "times of their own"),
    raw(f"{LAB}/observations?time={T}", arrow(ROWS), 422, "time", "leave it out", ARROW),
    raw(f"{DOOR}/observations?time={T}", b'{"time": [1], "state": [1]}', 422, "time", "leave it out"),
    *(whole(FREE.astype(kind), 422, "body", "uint8, int8 or bool") for kind in ("u2", "i8", "f4", "S1", "M8[s]", "c8")),
    *(whole(FREE.reshape(shape), 422, "body", "(4, 3, 2) or (24,)") for shape in ((2, 3, 4), (12, 2), (1, 24))),
    whole(np.zeros((), np.uint8), 422, "body", "shape"),
    whole(np.zeros(23, np.uint8), 422, "body", "shape"),
    whole(np.zeros((4, 3, 3), np.uint8), 422, "body", "shape"),
    whole(np.zeros(0, np.uint8), 422, "body", "shape"),
    whole(FREE + 255, 422, "body", "at least one"),
    whole(np.full(24, -1, np.int8), 422, "body", "at least one"),
    *(
        whole(np.where(np.arange(24) == 7, bad, 0).astype(np.uint8), 422, "body[7]", "0 (free)")
        for bad in (2, 128, 254)
    ),
    whole(np.where(np.arange(24) == 23, -2, -1).astype(np.int8), 422, "body[23]", "0 (free)"),
    whole(described("'|b1'", "(24,)", b"\7" * 24), 422, "body[0]", "0 (free)"),
    whole(described("'|u1'", "(24,)", b"\0" * 23), 400, None, "follow its header"),
    whole(described("'|u1'", "(24,)", b"\0" * 25), 400, None, "follow its header"),
    whole(described("'|u1'", "(-4, -3, 2)", b"\0" * 24), 400, None, "declares the shape"),
    whole(described("'|O'", "(24,)", b"\0" * 192), 422, "body", "uint8"),
    whole(b"", 400, None, "numpy.save"),
    whole(FREE, 422, "body", "(1,)", location=DOOR),
    raw(f"{LAB}/observations?time={T}", b"", 415, None, "application/x-npy", "text/csv"),
]
POSTS = [
    raw(f"{DOOR}/observations?source=" + "x" * 129, b'{"time": [1], "state": [1]}', 422, "source"),
    raw(f"{DOOR}/observations?source=%00", b'{"time": [1], "state": [1]}', 422, "source", "NUL"),
    raw(f"{DOOR}/observations", b'{"time": [1], "state": [1]}', 422, "Idempotency-Key", **{"Idempotency-Key": ""}),
    raw(
        f"{DOOR}/observations", b'{"time": [1], "state": [1]}', 422, "Idempotency-Key", **{"Idempotency-Key": "k" * 256}
    ),
    raw(f"{DOOR}/observations", b'{"\\ud800": NaN}', 422, "?", "NaN"),
    raw(f"{DOOR}/observations", b"", 400, None, "JSON"),
]


@table(*STATES)
def test_of_a_state(site: Untouched, case: Case) -> None:
    site.refuse(case)


@table(*CELLS)
def test_of_a_grid(site: Untouched, case: Case) -> None:
    site.refuse(case)


@table(*TABLES)
def test_in_arrow(site: Untouched, case: Case) -> None:
    site.refuse(case)


@table(*NPYS)
def test_in_npy(site: Untouched, case: Case) -> None:
    site.refuse(case)


@table(*GRIDS)
def test_of_whole_grids(site: Untouched, case: Case) -> None:
    site.refuse(case)


@table(*POSTS)
def test_with_odd_circumstances(site: Untouched, case: Case) -> None:
    site.refuse(case)


MANY = 40_000
SPOILS: list[tuple[str, str, dict[str, Any]]] = [
    (DOOR, "time", {"time": NOW + DAY}),
    (DOOR, "time", {"time": -1e12}),
    (DOOR, "state", {"state": 2}),
    (DOOR, "state", {"state": 255}),
    (LAB, "time", {"time": NOW + DAY}),
    (LAB, "state", {"state": 2}),
    (LAB, "cell", {"cell": 24}),
    (LAB, "cell", {"cell": 2**32 - 1}),
    (LAB, "cell", {"time": NOW - DAY, "cell": 0, "state": 1}),
]
"""Path, field and what stands in the spoilt row; the last contradicts the first row."""


@pytest.mark.parametrize("at", [1, 25_000, MANY - 1])
@pytest.mark.parametrize("spoil", range(len(SPOILS)))
@pytest.mark.parametrize("way", [columns, structured])
def test_one_bad_measurement_of_many_refuses_all(
    site: Untouched, way: Callable[..., Case], spoil: int, at: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tidemap.ingest.observation.BLOCK", 10_000)
    path, field, bad = SPOILS[spoil]
    table = {
        "time": NOW - DAY + np.arange(MANY),
        "cell": (np.arange(MANY) % 24).astype(np.uint32),
        "state": np.zeros(MANY, np.uint8),
    }
    if path == DOOR:
        del table["cell"]
    for name, value in bad.items():
        table[name][at] = value
    site.refuse(way(path, table, 422, f"{field}[{at}]"))


def test_one_bad_measurement_of_many_in_json_refuses_all(site: Untouched) -> None:
    time = (NOW - DAY + np.arange(5000)).tolist()
    for at in (0, 2500, 4999):
        states = [0] * 5000
        states[at] = 2
        site.refuse(state(time, states, f"state[{at}]"))
        late = [*time[:at], NOW + DAY, *time[at + 1 :]]
        site.refuse(state(late, [0] * 5000, f"time[{at}]"))
    looks = [{"time": t, "occupied": [1]} for t in time[:500]]
    for bad, location in (({"free": [3, 99]}, "free[1]"), ({"free": [3], "occupied": [3]}, "free[0]")):
        site.refuse(
            form(f"{LAB}/observations", {"observations": [*looks, {"time": T, **bad}]}, f"observations[500].{location}")
        )

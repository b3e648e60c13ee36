"""Real signals for tests, where ../shared/data has them: see its README."""

import gzip
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from zoneinfo import ZoneInfo

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.office import read_office
from tests.support.paths import ROOT
from tidemap.history.history import UNOBSERVED, History
from tidemap.history.timebase import TimeBase

DATA = ROOT.parent / "shared" / "data"
MONDAY = 345_600.0
"""5 January 1970, for signals whose date is not known."""
AMSTERDAM = "Europe/Amsterdam"


@dataclass(frozen=True, slots=True, eq=False)
class Real:
    """Cells observed on a time base, in a time zone."""

    history: History
    base: TimeBase
    time_zone: str


def needed(*parts: str) -> Path:
    """The path of a file, or the test skipped."""
    path = DATA.joinpath(*parts)
    if not path.is_file():
        pytest.skip(f"no real data: {path} is missing")
    return path


def office_minutes() -> NDArray[np.uint8]:
    """The office door per minute, the majority of its seconds, two weeks from a Monday: (20160,)."""
    needed("office", "week.csv.gz")
    states = np.full(14 * 1440, UNOBSERVED, np.uint8)
    office = read_office()
    for part in (office.week, office.day_1, office.day_2, office.day_3):
        minutes = part.state.reshape(-1, 60).mean(axis=1) >= 0.5
        first = int(part.time_s[0]) // 60
        states[first : first + minutes.size] = minutes
    return states


def aruba() -> Real:
    """Nine rooms per minute for 112 days; the weekday it began on is not known, and here a Monday."""
    with gzip.open(needed("aruba", "rooms.csv.gz")) as file:
        body = file.read().split(b"\n", 1)[1].replace(b"\n", b",").rstrip(b",")
    minute, room = np.array(body.split(b","), np.int64).reshape(-1, 2).T
    states = np.full((9, int(minute[-1]) + 1), UNOBSERVED, np.uint8)
    states[:, minute] = room == np.arange(1, 10)[:, np.newaxis]
    return Real(History.from_states(states), TimeBase(MONDAY, 60.0), "UTC")


def brains4buildings() -> Real:
    """Occupancy of two rooms by the building's own sensors, every 15 minutes from Monday, 10 October 2022."""
    parquet = pytest.importorskip("pyarrow.parquet")
    path = needed("brains4buildings", "b4b_preprocess_properties.parquet")
    table = parquet.read_table(path, columns=["bms_occupancy__bool", "id", "timestamp"]).to_pylist()
    start = datetime(2022, 10, 10, tzinfo=ZoneInfo(AMSTERDAM)).timestamp()
    rooms = sorted({row["id"] for row in table if row["bms_occupancy__bool"] is not None})
    states = np.full((len(rooms), 25 * 96), UNOBSERVED, np.uint8)
    for row in table:
        sample = int((row["timestamp"].timestamp() - start) // 900)
        if row["bms_occupancy__bool"] is not None and 0 <= sample < states.shape[1]:
            states[rooms.index(row["id"]), sample] = row["bms_occupancy__bool"] > 0
    return Real(History.from_states(states), TimeBase(start, 900.0), AMSTERDAM)


@dataclass(frozen=True, slots=True, eq=False)
class Things:
    """Things in a room, seen every half second by a detector that errs; truth: (n, n_samples) uint8."""

    read: History
    truth: NDArray[np.uint8]
    base: TimeBase

    def of(self, thing: int) -> "Things":
        """One of them."""
        return replace(self, read=self.read.cells([thing]), truth=self.truth[[thing]])


def room(part: str) -> Things:
    """Eight things, one of the recordings `train` and `test` of three hours."""
    with np.load(needed("room", f"{part}.npz")) as file:
        truth = np.array([file[f"{thing}_truth"] for thing in range(8)], np.uint8)
        states = np.full(truth.shape, UNOBSERVED, np.uint8)
        for thing, row in enumerate(states):
            row[np.rint(2 * file[f"{thing}_time_s"]).astype(np.int64)] = file[f"{thing}_seen"]
    return Things(History.from_states(states), truth, TimeBase(0.0, 0.5))

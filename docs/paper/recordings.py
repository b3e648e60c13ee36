"""The recordings that the figures and tables are made from."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tests.support.office import Office, Signal, read_office
from tests.support.paths import ROOT
from tests.unit.spectral import real
from tidemap.history.history import History
from tidemap.history.timebase import TimeBase

FOLDER = ROOT.parent / "shared" / "data"
OFFICE = ("office/week.csv.gz", "office/day_1.csv.gz", "office/day_2.csv.gz", "office/day_3.csv.gz")
ARUBA = ("aruba/rooms.csv.gz",)
BRAINS4BUILDINGS = ("brains4buildings/b4b_preprocess_properties.parquet",)
ROOM = ("room/train.npz", "room/test.npz")
SECONDS = TimeBase(0.0, 1.0)
DAY_S = 86_400
WEEK_MINUTES = 7 * 1440


def missing(needs: Sequence[str], folder: Path = FOLDER) -> list[str]:
    """The recordings that are not there."""
    return [each for each in needs if not (folder / each).is_file()]


@cache
def office() -> Office:
    """The office door once a second: a week, and three later days."""
    return read_office(FOLDER / "office")


@cache
def office_minutes() -> NDArray[np.uint8]:
    """The same per minute, the majority of its seconds, over the two weeks from a Monday, (20160,)."""
    return real.office_minutes()


@cache
def aruba() -> real.Real:
    """Nine rooms per minute for 112 days."""
    return real.aruba()


@cache
def brains4buildings() -> real.Real:
    """Two rooms every quarter of an hour, over the end of summer time."""
    return real.brains4buildings()


@cache
def room(part: str) -> real.Things:
    """Eight things seen by a detector that errs, for three hours: `train` or `test`."""
    return real.room(part)


def history(signal: Signal) -> History:
    """One cell, on `SECONDS`."""
    return History.from_states(signal.state[np.newaxis], start=int(signal.time_s[0]))


@dataclass(frozen=True, slots=True, eq=False)
class Runs:
    """Where a condition holds: intervals [start, stop) of samples, (n,) each."""

    start: NDArray[np.int64]
    stop: NDArray[np.int64]

    def __len__(self) -> int:
        return int(self.start.size)


def runs(holds: NDArray[np.bool_]) -> Runs:
    """The intervals in which a condition (n_samples,) holds."""
    edge = np.diff(holds.astype(np.int8), prepend=0, append=0)
    return Runs(np.flatnonzero(edge == 1), np.flatnonzero(edge == -1))

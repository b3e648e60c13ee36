"""The paper's own data: an office door observed once a second for a week, and three later days."""

import gzip
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tests.support.paths import ROOT

FOLDER = ROOT.parent / "shared" / "data" / "office"
PARTS = ("week", "day_1", "day_2", "day_3")


@dataclass(frozen=True, slots=True, eq=False)
class Signal:
    """time_s (n,) int64, seconds since the Monday midnight the week starts at; state (n,) uint8, 0 or 1."""

    time_s: NDArray[np.int64]
    state: NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Office:
    """The week to learn from, the paper's two extra days, and a Saturday two weeks later."""

    week: Signal
    day_1: Signal
    day_2: Signal
    day_3: Signal


def read_office(folder: Path = FOLDER) -> Office:
    """The four recordings; about 0.3 s."""
    return Office(**{part: _read(folder / f"{part}.csv.gz") for part in PARTS})


def missing(folder: Path = FOLDER) -> list[str]:
    """The names of the files that are not there."""
    return [f"{part}.csv.gz" for part in PARTS if not (folder / f"{part}.csv.gz").is_file()]


def _read(path: Path) -> Signal:
    with gzip.open(path, "rb") as file:
        _header, body = file.read().split(b"\n", 1)
    # Two integers a line: one flat parse of the whole file beats any reader of rows.
    values = np.array(body.replace(b"\n", b",").rstrip(b",").split(b","), dtype=np.int64).reshape(-1, 2)
    return Signal(time_s=values[:, 0].copy(), state=values[:, 1].astype(np.uint8))

"""Answers given what was read, by how long ago that was: a walk through twelve signals, beside three rivals."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from docs.paper import recordings
from docs.paper.boosting import Clocks, boosted
from docs.paper.document import number, table
from tests.unit.spectral import real
from tidemap.history.history import History
from tidemap.history.timebase import TimeBase
from tidemap.spectral.auto.selection import choose
from tidemap.spectral.civil import DAY_S
from tidemap.spectral.evaluation import BINS, Reliability, ScoreSums, expected_calibration_error
from tidemap.spectral.horizons import WalkPlan, walk
from tidemap.spectral.recipe import Recipe

NEEDS = (*recordings.OFFICE, *recordings.ARUBA, *recordings.BRAINS4BUILDINGS)
HORIZONS_S = (0.0, 300.0, 900.0, 3600.0, 4 * 3600.0, DAY_S, 7 * DAY_S)
"""0 stands for one interval."""
NAMES = ("one interval", "5 min", "15 min", "1 h", "4 h", "1 d", "1 wk")
KINDS = ("persistence", "rhythm", "boosting", "given what was read")


@dataclass(frozen=True, slots=True, eq=False)
class Signal:
    """One cell, learned from for `train_days` at first and again every `step_days`."""

    name: str
    history: History
    clocks: Clocks
    train_days: int
    step_days: int


@dataclass(frozen=True, slots=True, eq=False)
class Walked:
    """Scores of a signal by kind and horizon; None where a horizon is shorter than its interval."""

    name: str
    sums: dict[str, list[ScoreSums | None]]

    def log_loss(self, kind: str, horizon: int) -> float:
        """NaN where there is none."""
        found = self.sums[kind][horizon]
        return math.nan if found is None else found.scores().log_loss

    def ratio(self, horizon: int) -> float:
        """Ours to the better of persistence and rhythm."""
        best = min(self.log_loss("persistence", horizon), self.log_loss("rhythm", horizon))
        return self.log_loss(KINDS[-1], horizon) / best


def make(_images: Path) -> dict[str, str]:
    """Log loss by horizon and signal, beside the rivals, and reliability. Some minutes."""
    walked = [_walked(signal) for signal in signals()]
    return {
        "horizons": _by_signal(walked),
        "horizons_rivals": _by_rival(walked),
        "horizons_calibration": _by_calibration(walked),
        "horizons_reliability": _reliability(walked),
    }


def signals() -> Iterator[Signal]:
    """The office door, nine rooms of a home and two of a building."""
    office = History.from_states(recordings.office_minutes()[np.newaxis])
    yield Signal("office", office, Clocks(TimeBase(real.MONDAY, 60.0), "UTC"), 7, 2)
    for name, recorded, train, step in (
        ("aruba", recordings.aruba(), 42, 35),
        ("brains4buildings", recordings.brains4buildings(), 14, 5),
    ):
        for cell in range(recorded.history.n_cells):
            clocks = Clocks(recorded.base, recorded.time_zone)
            yield Signal(f"{name} {cell + 1}", recorded.history.cells([cell]), clocks, train, step)


def _walked(signal: Signal) -> Walked:
    base = signal.clocks.base
    day = round(DAY_S / base.interval_s)
    taken = [i for i, horizon_s in enumerate(HORIZONS_S) if not 0 < horizon_s < base.interval_s]
    horizons = tuple(max(1, round(HORIZONS_S[i] / base.interval_s)) for i in taken)
    plan = WalkPlan(signal.train_days * day, signal.step_days * day, horizons)
    ours = walk(signal.history, base, plan, partial(_recipe, signal.clocks))
    rival = boosted(signal.history, signal.clocks, plan)
    sums: dict[str, list[ScoreSums | None]] = {kind: [None] * len(HORIZONS_S) for kind in KINDS}
    for i, mine, other in zip(taken, ours, rival, strict=True):
        for kind, each in zip(KINDS, (mine.persistence, mine.rhythm, other, mine.conditioned), strict=True):
            sums[kind][i] = each
    return Walked(signal.name, sums)


def _recipe(clocks: Clocks, past: History) -> Recipe:
    return choose(past, clocks.base, time_zone=clocks.time_zone).recipe


def _by_signal(walked: list[Walked]) -> str:
    """Ours to the better of persistence and rhythm, and the geometric mean."""
    found = np.array([[each.ratio(i) for i in range(len(NAMES))] for each in walked])
    rows = [[each.name, *map(number, line)] for each, line in zip(walked, found, strict=True)]
    rows.append(["geometric mean", *map(number, np.exp(np.nanmean(np.log(found), axis=0)))])
    rows.append(["greatest", *map(number, np.nanmax(found, axis=0))])
    return table(("signal", *NAMES), rows)


def _by_rival(walked: list[Walked]) -> str:
    """Mean log loss over the signals, and the geometric mean of ours to boosting."""
    loss = np.array([[[each.log_loss(kind, i) for i in range(len(NAMES))] for kind in KINDS] for each in walked])
    rows = [[kind, *map(number, line)] for kind, line in zip(KINDS, np.nanmean(loss, axis=0), strict=True)]
    ratio = np.exp(np.nanmean(np.log(loss[:, 3] / loss[:, 2]), axis=0))
    return table(("answer", *NAMES), [*rows, ["ours / boosting", *map(number, ratio)]])


def _by_calibration(walked: list[Walked]) -> str:
    """The mean over the signals of the expected calibration error."""
    rows = []
    for kind in KINDS:
        gaps = [[_gap(each.sums[kind][i]) for each in walked] for i in range(len(NAMES))]
        rows.append([kind, *(number(float(np.nanmean(line)), 4) for line in gaps)])
    return table(("answer", *NAMES), rows)


def _gap(sums: ScoreSums | None) -> float:
    return math.nan if sums is None else expected_calibration_error(sums.reliability())


def _reliability(walked: list[Walked]) -> str:
    """Ours, all signals pooled: the share that was occupied, by the mean of what was said."""
    tables = [
        [found.reliability() for each in walked if (found := each.sums[KINDS[-1]][i]) is not None]
        for i in range(len(NAMES))
    ]
    names = [f"{k / BINS:.1f} to {(k + 1) / BINS:.1f}" for k in range(BINS)]
    return table(("p", *NAMES), [[name, *(_bin(each, k) for each in tables)] for k, name in enumerate(names)])


def _bin(tables: list[Reliability], k: int) -> str:
    """Said and seen in one bin."""
    count = np.array([each.count[k] for each in tables], float)
    if not count.sum():
        return "–"
    said, seen = (
        float(np.nansum(np.array(column) * count) / count.sum())
        for column in ([each.probability_mean[k] for each in tables], [each.observed_rate[k] for each in tables])
    )
    return f"{number(said)} → {number(seen)}"

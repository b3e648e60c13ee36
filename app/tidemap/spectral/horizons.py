"""Horizons: how good the answer given what was read some time before is, by a walk forwards through history."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tidemap.history.history import History
from tidemap.history.sequences import Sequences
from tidemap.history.timebase import TimeBase
from tidemap.spectral.belief import Beliefs
from tidemap.spectral.conditioning import Persistence, condition
from tidemap.spectral.detection import ReadCells, learn_detector
from tidemap.spectral.detector import Detector
from tidemap.spectral.evaluation import ScoreSums
from tidemap.spectral.model import fit_part
from tidemap.spectral.pairs import CellReadings
from tidemap.spectral.persistence import learn_persistence
from tidemap.spectral.prediction import predict_readings, predict_times
from tidemap.spectral.recipe import Recipe
from tidemap.spectral.sensor import Sensor
from tidemap.spectral.spectrum import Spectrum
from tidemap.spectral.switching import Switching, learn_switching
from tidemap.spectral.window import fft_window

MAX_FILTERED: Final = 4096
"""Readings before the first one that is predicted from, of those that err: as many make a belief."""


@dataclass(frozen=True, slots=True)
class WalkPlan:
    """Readings of samples from `start` on are predicted, each from what was read `horizons` samples before or earlier.

    What predicts them is learned anew every `step` samples, each time from all samples before.
    """

    start: int
    step: int
    horizons: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Erring:
    """What a sensor that errs read, and what is known of it.

    readings: what was measured of the cells of a history, without what is held after it for `hold` samples. sensor:
    None where its rates are learned.
    """

    readings: History
    sensor: Sensor | None = None
    hold: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Learned:
    """What was learned from all before a sample: the fit, how long states last, the rival of every cell, and what reads
    them where that errs."""

    spectrum: Spectrum
    persistence: Persistence
    switching: list[Switching]
    detector: Detector | None


@dataclass(frozen=True, slots=True, eq=False)
class HorizonSums:
    """Scores of one horizon: of the answer given what was read, of the rhythm alone, and of persistence alone."""

    horizon: int
    conditioned: ScoreSums
    rhythm: ScoreSums
    persistence: ScoreSums


@dataclass(frozen=True, slots=True, eq=False)
class Ahead:
    """Rows (n,) into the readings of a cell: those predicted, and of each the latest that may be known."""

    later: NDArray[np.int64]
    earlier: NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class _Cell:
    """The readings of a cell (n,), the rhythm's p at each that may be asked for, and the number of the cell."""

    number: int
    readings: CellReadings
    p: NDArray[np.float32]


Given = Callable[[Ahead, int], NDArray[np.floating]]
"""The probability of some readings of a cell as they are, given those at least a horizon (in samples) before each."""


def walk(
    history: History,
    base: TimeBase,
    plan: WalkPlan,
    choose: Callable[[History], Recipe],
    check: Callable[[], None] = lambda: None,
    erring: Erring | None = None,
) -> list[HorizonSums]:
    """Scores by horizon over all cells; only readings that had an earlier one to be predicted from are counted.

    choose: how to fit, from the past alone. `check` is called between cells; what it raises ends the walk. What a
    sensor that errs will read is predicted as it will read it, with its errors: nobody knows what was true. Nor is
    what is held after one of its readings another one.
    """
    sums = [HorizonSums(each, ScoreSums(), ScoreSums(), ScoreSums()) for each in plan.horizons]
    scored = history if erring is None else erring.readings
    for cut in range(plan.start, history.stop, plan.step):
        check()
        past = history.window(history.start, cut)
        learned = learn(past, base, choose(past), check, erring)
        known = scored.window(history.start, min(cut + plan.step, history.stop))
        for number in range(history.n_cells):
            check()
            _score(sums, CellReadings.of(known, number), number, (learned, erring, base), cut)
    return sums


def learn(
    past: History,
    base: TimeBase,
    recipe: Recipe,
    check: Callable[[], None] = lambda: None,
    erring: Erring | None = None,
) -> Learned:
    """All that an update would learn of the past, as it would."""
    part = (past.start, past.stop)
    if recipe.estimator == "fft":
        part = fft_window(past.seen(), *part, base.interval_s)
    spectrum = fit_part(past, recipe, base, part)
    check()
    plain = spectrum if recipe.carry_over == 0 else fit_part(past, replace(recipe, carry_over=0.0), base, part)
    check()
    readings = (CellReadings.of(past, cell) for cell in range(past.n_cells))
    rivals = [learn_switching(each.sample, each.state) for each in readings]
    detector = None if erring is None else _detector(erring, past, plain, base)
    return Learned(spectrum, learn_persistence(past, plain, base), rivals, detector)


def _detector(erring: Erring, past: History, spectrum: Spectrum, base: TimeBase) -> Detector:
    sequences = Sequences.of(erring.readings.window(past.start, past.stop))
    p = predict_readings(spectrum, np.arange(past.n_cells), sequences, base)
    return learn_detector(ReadCells(sequences, p.astype(np.float64)), base.interval_s, erring.sensor)


def ahead(readings: CellReadings, first: int, horizon: int) -> Ahead:
    """The readings from sample `first` on, each with the latest at least `horizon` samples before it."""
    later = np.arange(np.searchsorted(readings.sample, first), readings.sample.size)
    earlier = np.searchsorted(readings.sample, readings.sample[later] - horizon, side="right") - 1
    return Ahead(later[earlier >= 0], earlier[earlier >= 0])


def _score(
    sums: list[HorizonSums],
    readings: CellReadings,
    number: int,
    known: tuple[Learned, Erring | None, TimeBase],
    first: int,
) -> None:
    """Add the readings of one cell from sample `first` on."""
    learned, erring, base = known
    pairs = [ahead(readings, first, each.horizon) for each in sums]
    lowest = min((int(each.earlier[0]) for each in pairs if each.earlier.size), default=None)
    if lowest is None:
        return
    p = np.full(readings.sample.size, np.nan, np.float32)
    p[lowest:] = predict_times(learned.spectrum, base.time(readings.sample[lowest:]), [number])[0]
    cell = _Cell(number, readings, p)
    given = _by_persistence(cell, learned.persistence, base.interval_s)
    if learned.detector is not None and erring is not None:
        given = _by_belief(cell, learned.spectrum, learned.detector, erring.hold, base, lowest)
    for each, pair in zip(sums, pairs, strict=True):
        truth, apart = readings.state[pair.later], readings.sample[pair.later] - readings.sample[pair.earlier]
        each.conditioned.add(given(pair, each.horizon), truth)
        each.rhythm.add(p[pair.later], truth)
        each.persistence.add(learned.switching[number].expect(readings.state[pair.earlier], apart), truth)


def _by_persistence(cell: _Cell, persistence: Persistence, interval_s: float) -> Given:
    """Readings are true: the latest one known says what was, and how long that had lasted."""
    readings, p = cell.readings, cell.p

    def given(pair: Ahead, _: int) -> NDArray[np.floating]:
        state, apart = readings.state[pair.earlier], readings.sample[pair.later] - readings.sample[pair.earlier]
        age = readings.sample[pair.earlier] - readings.begin[pair.earlier] + 1
        kept = persistence.kept(state, apart * interval_s, age * interval_s)
        q = np.where(state != 0, p[pair.earlier], 1 - p[pair.earlier])
        return condition(p[pair.later], q, state, kept)

    return given


def _by_belief(cell: _Cell, spectrum: Spectrum, detector: Detector, hold: int, base: TimeBase, lowest: int) -> Given:
    """Readings err: what is believed after the latest one known, which is filtered from some before `lowest` on, is
    carried forward, and read with errors."""
    first = max(0, lowest + 1 - MAX_FILTERED)
    sample, state = cell.readings.sample[first:], cell.readings.state[first:]
    sequence = Sequences(np.array([0, len(sample)]), sample, state)
    rhythm = predict_readings(spectrum, [cell.number], sequence, base)
    believed = Beliefs.none(1, detector).traced(sequence, rhythm)

    def given(pair: Ahead, horizon: int) -> NDArray[np.floating]:
        known, asked = believed.rows(pair.earlier - first), cell.readings.sample[pair.later]
        return detector.sensor.reading_probability(known.ahead(cell.p[pair.later], asked, horizon, hold))

    return given

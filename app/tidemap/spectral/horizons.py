"""Horizons: how good the answer given what was read some time before is, by a walk forwards through history."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tidemap.history.history import History
from tidemap.history.timebase import TimeBase
from tidemap.spectral.conditioning import Persistence, condition
from tidemap.spectral.evaluation import ScoreSums
from tidemap.spectral.model import fit_part
from tidemap.spectral.pairs import CellReadings
from tidemap.spectral.persistence import learn_persistence
from tidemap.spectral.prediction import predict_times
from tidemap.spectral.recipe import Recipe
from tidemap.spectral.spectrum import Spectrum
from tidemap.spectral.switching import Switching, learn_switching
from tidemap.spectral.window import fft_window


@dataclass(frozen=True, slots=True)
class WalkPlan:
    """Readings of samples from `start` on are predicted, each from what was read `horizons` samples before or earlier.

    What predicts them is learned anew every `step` samples, each time from all samples before.
    """

    start: int
    step: int
    horizons: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Learned:
    """What was learned from all before a sample: the fit, how long states last, and the rival of every cell."""

    spectrum: Spectrum
    persistence: Persistence
    switching: list[Switching]


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


def walk(
    history: History,
    base: TimeBase,
    plan: WalkPlan,
    choose: Callable[[History], Recipe],
    check: Callable[[], None] = lambda: None,
) -> list[HorizonSums]:
    """Scores by horizon over all cells; only readings that had an earlier one to be predicted from are counted.

    choose: how to fit, from the past alone. `check` is called between cells; what it raises ends the walk.
    """
    sums = [HorizonSums(each, ScoreSums(), ScoreSums(), ScoreSums()) for each in plan.horizons]
    for cut in range(plan.start, history.stop, plan.step):
        check()
        past = history.window(history.start, cut)
        learned = learn(past, base, choose(past), check)
        known = history.window(history.start, min(cut + plan.step, history.stop))
        for cell in range(history.n_cells):
            check()
            _score(sums, CellReadings.of(known, cell), cell, learned, base, cut)
    return sums


def learn(past: History, base: TimeBase, recipe: Recipe, check: Callable[[], None] = lambda: None) -> Learned:
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
    return Learned(spectrum, learn_persistence(past, plain, base), rivals)


def ahead(readings: CellReadings, first: int, horizon: int) -> Ahead:
    """The readings from sample `first` on, each with the latest at least `horizon` samples before it."""
    later = np.arange(np.searchsorted(readings.sample, first), readings.sample.size)
    earlier = np.searchsorted(readings.sample, readings.sample[later] - horizon, side="right") - 1
    return Ahead(later[earlier >= 0], earlier[earlier >= 0])


def _score(
    sums: list[HorizonSums], readings: CellReadings, cell: int, learned: Learned, base: TimeBase, first: int
) -> None:
    """Add the readings of one cell from sample `first` on."""
    pairs = [ahead(readings, first, each.horizon) for each in sums]
    lowest = min((int(each.earlier[0]) for each in pairs if each.earlier.size), default=None)
    if lowest is None:
        return
    p = np.full(readings.sample.size, np.nan, np.float32)
    p[lowest:] = predict_times(learned.spectrum, base.time(readings.sample[lowest:]), [cell])[0]
    for each, pair in zip(sums, pairs, strict=True):
        truth = readings.state[pair.later]
        state, apart = readings.state[pair.earlier], readings.sample[pair.later] - readings.sample[pair.earlier]
        age = readings.sample[pair.earlier] - readings.begin[pair.earlier] + 1
        kept = learned.persistence.kept(state, apart * base.interval_s, age * base.interval_s)
        q = np.where(state != 0, p[pair.earlier], 1 - p[pair.earlier])
        each.conditioned.add(condition(p[pair.later], q, state, kept), truth)
        each.rhythm.add(p[pair.later], truth)
        each.persistence.add(learned.switching[cell].expect(state, apart), truth)

"""Model: spectrum and outliers together, and the paper's four operations on them (II-B 2, 3)."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import logit

from tidemap.history import bits
from tidemap.history.history import UNOBSERVED, History
from tidemap.history.timebase import TimeBase
from tidemap.spectral.estimators import fit_recipe
from tidemap.spectral.outliers import Outliers, count, find_outliers
from tidemap.spectral.prediction import predict
from tidemap.spectral.recipe import Recipe
from tidemap.spectral.reconstruction import predicted_words
from tidemap.spectral.spectrum import Spectrum
from tidemap.spectral.static import expected_share

__all__ = ["SpectralModel", "accuracy", "add", "predict", "reconstruct", "refit", "update"]


@dataclass(frozen=True, slots=True, eq=False)
class SpectralModel:
    """Spectrum P and outliers O of the samples [start, stop).

    observed (n_cells, ceil((stop - start) / 8)) uint8, bitorder "little": the samples that were;
    of the others the model says nothing.
    """

    spectrum: Spectrum
    outliers: Outliers
    base: TimeBase
    start: int
    stop: int
    observed: NDArray[np.uint8]

    @property
    def n_cells(self) -> int:
        return self.spectrum.n_cells


def reconstruct(model: SpectralModel, start: int | None = None, stop: int | None = None) -> NDArray[np.uint8]:
    """s(t) = (p(t) > 0.5) ⊕ (t ∈ O) (Eq. 1), dense (n_cells, stop - start) uint8.

    Over [start, stop), by default all; UNOBSERVED where nothing was observed. Lossless for every
    order on the machine that found the outliers.
    """
    start = model.start if start is None else start
    stop = model.stop if stop is None else stop
    words = predicted_words(model.spectrum, model.base, start, stop)
    first = bits.WORD * (start // bits.WORD)
    bits.flip_runs(words, first, model.outliers.offset, model.outliers.start, model.outliers.stop)
    states = _unpack(words, start - first, stop - first)
    seen = History(model.start, model.stop - model.start, model.observed, model.observed)
    return np.where(seen.window(start, stop).states() == UNOBSERVED, np.uint8(UNOBSERVED), states)


def _unpack(words: NDArray[np.uint64], start: int, stop: int) -> NDArray[np.uint8]:
    return np.unpackbits(words.astype("<u8").view(np.uint8), axis=1, bitorder="little")[:, start:stop]


def add(model: SpectralModel, sample: int, state: int, cell: int = 0) -> SpectralModel:
    """The model with one more measurement (Eq. 2): t joins O if s'(t) ≠ state, otherwise leaves it.

    A later measurement of a sample replaces the earlier one; samples outside [start, stop) widen
    the window. Copies O and the plane: for single measurements, `update` is for many.
    """
    if state not in (0, 1):
        raise ValueError(f"a measurement is 0 or 1, not {state}")
    if not 0 <= cell < model.n_cells:
        raise IndexError(f"cell {cell} of {model.n_cells}")
    measured = np.array([[state]], np.uint8)
    history = History.from_measurements(model.n_cells, sample, sample + 1, [cell], [sample], measured)
    seen = History(model.start, model.stop - model.start, model.observed, model.observed)
    hull = seen.overlay(history)
    wrong = bool(find_outliers(model.spectrum, history, model.base).start.size)
    return replace(
        model,
        outliers=_set(model.outliers, cell, sample, wrong),
        start=hull.start,
        stop=hull.stop,
        observed=hull.observed,
    )


def _set(outliers: Outliers, cell: int, sample: int, member: bool) -> Outliers:
    """O with one sample of a cell in it or not."""
    before, after = int(outliers.offset[cell]), int(outliers.offset[cell + 1])
    runs = [(int(a), int(b)) for a, b in outliers.of(cell)]
    apart = [part for run in runs for part in _without(run, sample)]
    joined = _join(sorted([*apart, (sample, sample + 1)])) if member else apart
    offset = outliers.offset.copy()
    offset[cell + 1 :] += len(joined) - (after - before)
    middle = np.array(joined, np.int64).reshape(-1, 2)
    return Outliers(
        offset,
        np.concatenate((outliers.start[:before], middle[:, 0], outliers.start[after:])),
        np.concatenate((outliers.stop[:before], middle[:, 1], outliers.stop[after:])),
    )


def _without(run: tuple[int, int], sample: int) -> list[tuple[int, int]]:
    start, stop = run
    if not start <= sample < stop:
        return [run]
    return [part for part in ((start, sample), (sample + 1, stop)) if part[0] < part[1]]


def _join(runs: list[tuple[int, int]]) -> list[tuple[int, int]]:
    joined = runs[:1]
    for start, stop in runs[1:]:
        if start == joined[-1][1]:
            joined[-1] = (joined[-1][0], stop)
        else:
            joined.append((start, stop))
    return joined


def update(
    history: History,
    estimator: str,
    order: int,
    base: TimeBase,
    fit_window: tuple[int, int] | None = None,
) -> SpectralModel:
    """`refit` with nothing but a name and an order."""
    return refit(history, Recipe(estimator, order), base, fit_window)


def refit(history: History, recipe: Recipe, base: TimeBase, fit_window: tuple[int, int] | None = None) -> SpectralModel:
    """The paper's model update: the spectrum from `fit_window`, by default all of the history, and the
    outliers of the whole history. ValueError on an unknown estimator."""
    spectrum = fit_part(history, recipe, base, fit_window)
    outliers = find_outliers(spectrum, history, base)
    return SpectralModel(spectrum, outliers, base, history.start, history.stop, history.observed)


def fit_part(history: History, recipe: Recipe, base: TimeBase, part: tuple[int, int] | None = None) -> Spectrum:
    """The spectrum of the samples `part` = [start, stop) of a history, by default of all.

    A cell that was observed only outside of them keeps the expected share of its whole history: what is mapped once
    does not vanish. ValueError on an unknown estimator.
    """
    spectrum = fit_recipe(history if part is None else history.window(*part), recipe, base)
    unseen = np.isnan(spectrum.mean) & history.ever_observed()
    if not unseen.any():
        return spectrum
    share = expected_share(history.count_occupied()[unseen], history.count_observed()[unseen])
    mean = spectrum.mean.copy()
    mean[unseen] = logit(share) if spectrum.link == "logit" else share
    return replace(spectrum, mean=mean)


def accuracy(model: SpectralModel) -> float:
    """1 - wrong / observed over all cells (one minus Eq. 4 and 5); NaN where nothing was observed."""
    observed = np.zeros(model.n_cells, np.int64)
    bits.count_ones(model.observed, observed)
    total = int(observed.sum())
    return float("nan") if total == 0 else 1.0 - int(count(model.outliers).sum()) / total

"""How right maps of the laboratory are: about what was seen, as in the paper, and about what was there."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from docs.paper.lab_week import BASE, ORDER, LabMaps
from tidemap.history.history import History
from tidemap.spectral.estimators import fit_recipe
from tidemap.spectral.outliers import count_outliers
from tidemap.spectral.recipe import Recipe
from tidemap.spectral.spectrum import Spectrum, select

MIN_SEEN = 0.05
"""A cell counts from this share of visits on in which it is seen from the true pose; others are glimpsed by chance."""


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Shares of states that a spectrum has right: of the week that it was fitted to, and of the days after it."""

    week: float
    later: float


def fitted(history: History, samples: tuple[int, int]) -> Spectrum:
    """The paper's spectrum, of order 15, of the samples [start, stop)."""
    return fit_recipe(history.window(*samples), Recipe("fft", ORDER), BASE)


def accuracy(spectrum: Spectrum, history: History) -> float:
    """One minus Eq. 5 over all cells; what a map does not know is wrong."""
    observed, wrong = history.count_observed(), count_outliers(spectrum, history, BASE)
    wrong = np.where(np.isnan(spectrum.mean), observed, wrong)
    return 1.0 - float(wrong.sum()) / float(observed.sum())


def against_observed(history: History, split: int) -> Accuracy:
    """The paper's reconstruction and prediction: fitted to the samples before `split`, judged by the same history."""
    week, later = (history.start, split), (split, history.stop)
    spectrum = fitted(history, week)
    known = np.flatnonzero(~np.isnan(spectrum.mean))
    spectrum, history = select(spectrum, known), history.cells(known)
    return Accuracy(accuracy(spectrum, history.window(*week)), accuracy(spectrum, history.window(*later)))


def known_cells(maps: LabMaps) -> NDArray[np.int64]:
    """The cells that are often enough seen from the true poses."""
    seen = maps.seen["true"].count_observed()
    return np.flatnonzero(seen >= MIN_SEEN * len(maps.posted))


def against_truth(maps: LabMaps, poses: str, split: int, cells: NDArray[np.int64]) -> float:
    """The share of states before `split` that a map has right of some cells, by what was there; poses: whose map."""
    week = (maps.truth.start, split)
    spectrum = fitted(maps.seen[poses].cells(cells), week)
    return accuracy(spectrum, maps.truth.cells(cells).window(*week))

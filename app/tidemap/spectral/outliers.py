"""Outliers: the intervals in which the thresholded prediction differs from what was observed."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tidemap.history import bits
from tidemap.history.history import History
from tidemap.history.intervals import Runs, offsets
from tidemap.history.timebase import TimeBase
from tidemap.spectral.reconstruction import predicted_words
from tidemap.spectral.spectrum import Spectrum


@dataclass(frozen=True, slots=True, eq=False)
class Outliers(Runs):
    """O: the runs of samples that the prediction got wrong; those of a cell never touch."""

    @classmethod
    def empty(cls, n_cells: int) -> Self:
        none = np.zeros(0, np.int64)
        return cls(np.zeros(n_cells + 1, np.int64), none, none)


def find_outliers(spectrum: Spectrum, history: History, base: TimeBase) -> Outliers:
    """O = {t : s(t) ≠ (p(t) > 0.5)} over the whole history (Eq. 2, t ∈ O).

    Unobserved samples are no outliers and split intervals. The history may be longer or shorter
    than the window of the fit. Cost per varying cell: one multiplication and sum per sample and
    component, 64 samples at a time.
    """
    return from_words(*_wrong(spectrum, history, base))


def count_outliers(spectrum: Spectrum, history: History, base: TimeBase) -> NDArray[np.int64]:
    """`count` of `find_outliers`, without its intervals: of noise they take sixteen times as much as the history."""
    words, _ = _wrong(spectrum, history, base)
    total = np.zeros(history.n_cells, np.int64)
    bits.count_words(words, total)
    return total


def _wrong(spectrum: Spectrum, history: History, base: TimeBase) -> tuple[NDArray[np.uint64], int]:
    """Words whose set bits are the outliers, and the sample of the first bit."""
    if spectrum.n_cells != history.n_cells:
        raise ValueError(f"a spectrum of {spectrum.n_cells} and a history of {history.n_cells} cells")
    words = predicted_words(spectrum, base, history.start, history.stop)
    first = bits.WORD * (history.start // bits.WORD)
    bits.mismatch(words, history.observed, history.occupied, first - history.start)
    return words, first


def from_words(words: NDArray[np.uint64], first: int) -> Outliers:
    """The runs of set bits of every row; `first` is the sample of bit 0 of word 0."""
    offset = offsets(bits.count_runs, words)
    start, stop = np.empty(int(offset[-1]), np.int64), np.empty(int(offset[-1]), np.int64)
    bits.runs(words, first, start, stop)
    return Outliers(offset, start, stop)


def count(outliers: Outliers) -> NDArray[np.int64]:
    """The samples in O per cell, (n_cells,): the sum of Eq. 5."""
    total = np.concatenate(([0], np.cumsum(outliers.stop - outliers.start)))
    return np.asarray(np.diff(total[outliers.offset]), np.int64)

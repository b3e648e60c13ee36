"""Periods: a rhythm that is no part of the civil week, found by the FFT of what `calendar` leaves unexplained."""

from typing import Final

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from tidemap.history.history import UNOBSERVED, History
from tidemap.history.timebase import TimeBase
from tidemap.spectral.calendar.waves import OVERTONES, SLOT_S
from tidemap.spectral.civil import WEEK_S
from tidemap.spectral.prediction import predict_times
from tidemap.spectral.spacing import spacing
from tidemap.spectral.spectrum import Spectrum
from tidemap.spectral.window import without_pauses

CYCLES: Final = 5
"""A period has to be seen this often."""
STRENGTH: Final = 25.0
"""How far a peak stands over the median around it; of a million peaks of noise alone one would reach 20."""
AROUND: Final = 50
MAX_SAMPLES: Final = 1 << 18
FINER: Final = 4
"""Frequencies per cycle of the history."""


def find_period(history: History, spectrum: Spectrum, base: TimeBase) -> float | None:
    """The period, in seconds, of the greatest peak of the residual spectra of all cells, None where none stands out.

    Not within a cycle of the history of a harmonic of the week, and none whose overtones are faster than slots, or the
    spacing of observations, can tell. O(n log n) in the latest MAX_SAMPLES.
    """
    start, stop = without_pauses(history.seen(), history.start, history.stop, base.interval_s)
    history = history.window(max(start, stop - MAX_SAMPLES), stop)
    if not history.n_samples or not history.n_cells:
        return None
    power, allowed = _power(history, spectrum, base)
    frequency = _frequencies(history, base)
    span_s = history.n_samples * base.interval_s
    cycles = frequency * WEEK_S
    allowed &= np.abs(cycles - np.rint(cycles)) > np.minimum(0.25, WEEK_S / span_s)
    allowed &= frequency * span_s >= CYCLES
    strength = np.where(allowed, power / _background(power), 0)
    best = int(np.argmax(strength))
    return float(1 / frequency[best]) if strength[best] > STRENGTH else None


def _frequencies(history: History, base: TimeBase) -> NDArray[np.float64]:
    return np.asarray(np.fft.rfftfreq(FINER * _length(history), base.interval_s), np.float64)


def _length(history: History) -> int:
    return int(scipy.fft.next_fast_len(history.n_samples, real=True))


def _power(history: History, spectrum: Spectrum, base: TimeBase) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """The mean over cells of |FT(mask · (s - p))|², each divided by what noise of variance p (1 - p) would have.

    At every frequency of the cells that tell it, and whether any does.
    """
    time = base.time(np.arange(history.start, history.stop))
    frequency = _frequencies(history, base)
    unit_s = np.maximum(spacing(history, np.arange(history.n_cells)) * base.interval_s, SLOT_S)
    total, n_cells = np.zeros(frequency.size), np.zeros(frequency.size, np.int64)
    for cell in range(history.n_cells):
        resolved = slice(int(np.searchsorted(frequency, 1 / (2 * OVERTONES * unit_s[cell]), side="right")))
        state = history.cells([cell]).states()[0]
        p = predict_times(spectrum, time, [cell])[0]
        residual = np.where(state == UNOBSERVED, 0, state - np.nan_to_num(p))
        transform = scipy.fft.rfft(residual, FINER * _length(history))[resolved]
        total[resolved] += np.abs(transform) ** 2 / max(1e-9, float((residual * residual).sum()))
        n_cells[resolved] += 1
    return total / np.maximum(n_cells, 1), n_cells > 0


def _background(power: NDArray[np.float64]) -> NDArray[np.float64]:
    """The median of blocks of frequencies, interpolated: noise that lasts has more power at low ones."""
    n_blocks = max(1, power.size // (AROUND * FINER))
    parts = np.array_split(power, n_blocks)
    middle = np.cumsum([part.size for part in parts]) - power.size / n_blocks / 2
    return np.asarray(np.interp(np.arange(power.size), middle, [max(1e-12, np.median(part)) for part in parts]))

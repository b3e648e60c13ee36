"""Weekly: the thresholded prediction of spectra that repeat every civil week.

Samples of such a spectrum are looked up in one week of the clock on the wall; only the blocks of
64 that occur are computed; a year costs little more than a week. The value of a sample depends on its block
of that week alone, so it is the same bit for bit whichever span it was asked with.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tidemap.history.bits import WORD, Words
from tidemap.history.jit import kernel
from tidemap.history.timebase import TimeBase
from tidemap.spectral import kernels
from tidemap.spectral.civil import DAY_S, WEEK_S
from tidemap.spectral.prediction import TABLE_SIZE, tau_phasors
from tidemap.spectral.spectrum import Spectrum, tau

OFFSET_S: Final = 900.0
"""Clocks differ from UTC by whole quarters of an hour: see `civil`."""
NEAR: Final = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Clock:
    """Civil weeks in steps of the samples: step j begins phase_s + j interval_s after Monday's midnight."""

    interval_s: float
    phase_s: float
    n_steps: int

    def step(self, tau_s: NDArray[np.float64]) -> NDArray[np.int64]:
        """The step of the week that begins at civil seconds, 0 … n_steps - 1."""
        return np.rint((tau_s - self.phase_s) / self.interval_s).astype(np.int64) % self.n_steps


def clock(spectrum: Spectrum, base: TimeBase) -> Clock | None:
    """The clock of a spectrum that repeats weekly on samples that fall on the same steps in every week, else None."""
    steps = OFFSET_S / base.interval_s
    cycles = spectrum.frequency_hz * WEEK_S
    whole = abs(steps - round(steps)) < NEAR and bool(np.all(np.abs(cycles - np.rint(cycles)) < NEAR))
    if spectrum.time_zone is None or not whole or round(steps) < 1:
        return None
    phase_s = float(tau(spectrum, base.time(0)) % base.interval_s)
    return Clock(base.interval_s, phase_s, round(WEEK_S / base.interval_s))


def fill_weekly(spectrum: Spectrum, base: TimeBase, week: Clock, first: int, threshold: float, words: Words) -> None:
    """words (n_cells, n_blocks) of the cells with waves: bits where p is over the threshold on its scale."""
    block = first + np.arange(words.shape[1])
    begins, ends = (tau(spectrum, base.time(block * WORD + at)) for at in (0, WORD - 1))
    step = week.step(begins)
    span_s = (WORD - 1) * base.interval_s
    # A block that is longer than a day may hold a holiday that neither of its ends shows.
    hidden = spectrum.calendar is not None and span_s >= DAY_S
    odd = np.flatnonzero((np.abs(ends - begins - span_s) > NEAR) | hidden)
    samples = (block[odd, np.newaxis] * WORD + np.arange(WORD)).ravel()
    single = week.step(tau(spectrum, base.time(samples)))
    reached = np.concatenate((step // WORD, (step + WORD - 1) // WORD, single // WORD))
    used = np.unique(reached)
    table = _blocks_of_week(spectrum, week, used, threshold)
    low, high = np.searchsorted(used, step // WORD), np.searchsorted(used, (step + WORD - 1) // WORD)
    _look_up(spectrum.cell, table, low, high, step % WORD, words)
    if odd.size:
        found = (table[:, np.searchsorted(used, single // WORD)] >> (single % WORD).astype(np.uint64)) & np.uint64(1)
        packed = np.packbits(found.astype(np.uint8).reshape(-1, WORD), axis=1, bitorder="little")
        words[np.ix_(spectrum.cell, odd)] = np.ascontiguousarray(packed).view("<u8").reshape(-1, odd.size)


def _blocks_of_week(spectrum: Spectrum, week: Clock, used: NDArray[np.int64], threshold: float) -> Words:
    """The blocks `used` of the week for every cell with waves, (n_varying, used.size)."""
    rows, mean = np.arange(spectrum.cell.size, dtype=np.int32), spectrum.mean[spectrum.cell]
    away = np.arange(0.5, WORD // 2) * week.interval_s
    phasor = np.empty((spectrum.n_waves, away.size), np.complex64)
    kernels.unit_phasors(spectrum.frequency_hz, away, phasor)
    offset = np.concatenate((phasor.real, phasor.imag), axis=1)
    begins = np.asarray(week.phase_s + used * (WORD * week.interval_s), np.float64)
    table = np.zeros((rows.size, used.size), np.uint64)
    span = (WORD - 1) * week.interval_s
    for part in np.array_split(np.arange(used.size), -(-used.size * spectrum.n_waves // TABLE_SIZE)):
        anchor = tau_phasors(spectrum, begins[part] + span / 2)
        found = np.empty((rows.size, part.size), np.uint64)
        kernels.threshold_blocks(rows, spectrum.index, spectrum.coefficient, mean, threshold, anchor, offset, found)
        table[:, part] = found
    if spectrum.gate.any():
        for at in np.flatnonzero(_weekend(begins) != _weekend(begins + span)):
            _fill_steps(spectrum, rows, mean, begins[at] + week.interval_s * np.arange(WORD), threshold, table[:, at])
    return table


def _weekend(tau_s: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.asarray(tau_s // DAY_S % 7 >= 5)


def _fill_steps(
    spectrum: Spectrum,
    rows: NDArray[np.int32],
    mean: NDArray[np.float32],
    tau_s: NDArray[np.float64],
    threshold: float,
    out: Words,
) -> None:
    """A block in which the weekend begins or ends: a phasor for every wave and step."""
    value = np.repeat(mean[:, np.newaxis], WORD, axis=1)
    waves = (rows, spectrum.index, spectrum.coefficient)
    kernels.add_waves_over_time(*waves, tau_phasors(spectrum, tau_s), value)
    out[:] = np.packbits(value > threshold, axis=1, bitorder="little").view("<u8")[:, 0]


@kernel
def _look_up(
    cell: NDArray[np.int32],
    table: Words,
    low: NDArray[np.int64],
    high: NDArray[np.int64],
    shift: NDArray[np.int64],
    words: Words,
) -> None:
    """words[cell, block]: 64 bits from bit `shift` of table[:, low] on, the rest from table[:, high]."""
    for row in range(cell.size):
        for block in range(low.size):
            word = table[row, low[block]] >> np.uint64(shift[block])
            if shift[block]:
                word |= table[row, high[block]] << np.uint64(WORD - shift[block])
            words[cell[row], block] = word

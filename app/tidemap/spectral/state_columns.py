"""State columns: probability, state and verdict of many cells at one time, written where they are sent from (Eq. 3)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tidemap.spectral import kernels
from tidemap.spectral.prediction import phasors, probability, share_rows
from tidemap.spectral.spectrum import Spectrum

BLOCK: Final = 1 << 15
"""Cells with waves that are answered at a time, so that their values stay in the processor's cache."""
CONDITIONED: Final = 1 << 18
"""Cells that are conditioned at a time, likewise."""
CONDITIONING: Final = 2
"""Coefficients that take as long as to condition one cell."""

Conditioning = Callable[[slice, NDArray[np.float32], NDArray[np.float32]], object]
"""Write the probability of some rows given what was read of them, from that of the rhythm; (n,) each."""


@dataclass(frozen=True, slots=True, eq=False)
class StateColumns:
    """What is said of some cells at one time, to be written: probability (n,) float32, state and verdict (n,) uint8."""

    probability: NDArray[np.float32]
    state: NDArray[np.uint8]
    verdict: NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Waves:
    """The waves of a spectrum at one time; row i is about row `at[i]`, ascending, of the cells that are answered.

    at (n_varying,) int32; phasor (n_waves,) complex64.
    """

    spectrum: Spectrum
    at: NDArray[np.int32]
    phasor: NDArray[np.complex64]

    @classmethod
    def of(cls, spectrum: Spectrum, at: NDArray[np.int32], time: float) -> "Waves":
        """Those at a time (Unix seconds)."""
        return cls(spectrum, at, phasors(spectrum, np.array([time], np.float64))[:, 0].copy())

    def values(self, rows: slice) -> NDArray[np.float32]:
        """The probability of some rows of waves; not clipped, NaN where never observed."""
        spectrum = self.spectrum
        value = np.empty(rows.stop - rows.start, np.float32)
        waves = (spectrum.cell[rows], spectrum.index[rows], spectrum.coefficient[rows], self.phasor)
        kernels.values(spectrum.mean, *waves, value)
        return probability(spectrum, value) if spectrum.link == "logit" else value


def write_states(probability: NDArray[np.float32], confidence: float, out: StateColumns) -> None:
    """Write probabilities (n,) and what is said from them, as `state` and `verdict`."""
    np.copyto(out.probability, probability)
    kernels.write_states(confidence, 1 - confidence, out.probability, out.state, out.verdict)


def write_waves(
    spectrum: Spectrum, time: float, confidence: float, at: NDArray[np.int32], out: StateColumns, threads: int = 1
) -> None:
    """Write the answer at a time (Unix seconds) of the cells that have waves to their places `at` (n_varying,) int32.

    As `predict`, `state` and `verdict`; of a cell that was never observed nothing is written.
    """
    waves = Waves.of(spectrum, at, time)

    def write(part: slice) -> None:
        for rows in _blocks(part, BLOCK):
            value = waves.values(rows)
            kernels.write_verdicts(at[rows], value, confidence, 1 - confidence, out.probability, out.state, out.verdict)

    share_rows(spectrum.cell.size, spectrum.order, threads, write)


def write_conditioned(
    waves: Waves,
    p: NDArray[np.float32],
    condition: Conditioning,
    confidence: float,
    out: StateColumns,
    threads: int = 1,
) -> None:
    """Write the answer of all cells given what was read of them, a block at a time.

    p (n,): the probability of those without waves; that of the others is written there. As `predict`, `condition`,
    `state` and `verdict`.
    """

    def write(part: slice) -> None:
        for rows in _blocks(part, CONDITIONED):
            first, last = np.searchsorted(waves.at, (rows.start, rows.stop)).tolist()
            kernels.put_known(waves.at[first:last], waves.values(slice(first, last)), p)
            condition(rows, p[rows], out.probability[rows])
            where = (out.probability[rows], out.state[rows], out.verdict[rows])
            kernels.write_states(confidence, 1 - confidence, *where)

    cost = CONDITIONING + waves.spectrum.coefficient.size / max(1, p.size)
    share_rows(p.size, cost, threads, write)


def _blocks(part: slice, size: int) -> list[slice]:
    return [slice(first, min(first + size, part.stop)) for first in range(part.start, part.stop, size)]

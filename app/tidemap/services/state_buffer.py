"""State buffers: the state of a whole map as it is sent. A question rewrites only the cells that have waves."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tidemap.formats.arrow import ArrowBuffer
from tidemap.formats.table import Column, Labels
from tidemap.spectral.prediction import VERDICTS, StateColumns, known, state, verdict, write_waves
from tidemap.spectral.prediction import probability as on_link
from tidemap.spectral.spectrum import Spectrum


@dataclass(frozen=True, slots=True, eq=False)
class StateBuffer:
    """The Arrow columns cell, probability, state and verdict of the cells of one spectrum that have been observed.

    at (n_varying,) int32: the rows of those that have waves. What is said of the others holds at every time.
    """

    arrow: ArrowBuffer
    at: NDArray[np.int32]
    confidence: float

    @classmethod
    def of(cls, spectrum: Spectrum, confidence: float) -> "StateBuffer":
        """A new one, on which nothing is said yet of cells with waves."""
        cells = known(spectrum)
        standing = on_link(spectrum, spectrum.mean[cells])
        columns: dict[str, Column] = {
            "cell": cells.astype(np.uint32),
            "probability": standing,
            "state": state(standing, confidence),
            "verdict": Labels(verdict(standing, confidence), VERDICTS),
        }
        return cls(ArrowBuffer.of(columns), np.searchsorted(cells, spectrum.cell).astype(np.int32), confidence)

    @property
    def memory(self) -> NDArray[np.uint8]:
        """What is sent, after a head with the facts."""
        return self.arrow.content

    @property
    def n_bytes(self) -> int:
        """All that it takes."""
        return self.memory.nbytes + self.at.nbytes

    def write(self, spectrum: Spectrum, time: float, threads: int) -> None:
        """The state at a time (Unix seconds) by the spectrum that it was made for."""
        columns = self.arrow.columns
        answer = StateColumns(columns["probability"], columns["state"], columns["verdict"].view(np.uint8))
        write_waves(spectrum, time, self.confidence, self.at, answer, threads)

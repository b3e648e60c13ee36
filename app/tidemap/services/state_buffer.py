"""State buffers: the state of a whole map as it is sent. A question rewrites only what changes."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tidemap.formats.arrow import ArrowBuffer
from tidemap.formats.table import Column, Labels, Nullable
from tidemap.history.history import UNOBSERVED
from tidemap.spectral.prediction import VERDICTS, known, state, verdict
from tidemap.spectral.prediction import probability as on_link
from tidemap.spectral.spectrum import Spectrum
from tidemap.spectral.state_columns import (
    Conditioning,
    StateColumns,
    Waves,
    write_conditioned,
    write_states,
    write_waves,
)

NOTHING: Final[Mapping[str, Column]] = MappingProxyType({})


@dataclass(slots=True, eq=False)
class StateBuffer:
    """The Arrow columns cell, probability, state and verdict of the cells of one spectrum that have been observed, and
    more columns that hold as long as it is kept.

    at (n_varying,) int32: the rows of those that have waves. standing (n_known,) float32: the rhythm's probability of
    the others, at every time. conditioned: whether it was written last given what was read.
    """

    arrow: ArrowBuffer
    at: NDArray[np.int32]
    standing: NDArray[np.float32]
    confidence: float
    conditioned: bool = False

    @classmethod
    def of(cls, spectrum: Spectrum, confidence: float, more: Mapping[str, Column] = NOTHING) -> "StateBuffer":
        """A new one, on which nothing is said yet of cells with waves."""
        cells = known(spectrum)
        standing = on_link(spectrum, spectrum.mean[cells])
        columns: dict[str, Column] = {
            "cell": cells.astype(np.uint32),
            "probability": standing,
            "state": state(standing, confidence),
            "verdict": Labels(verdict(standing, confidence), VERDICTS),
            **more,
        }
        at = np.searchsorted(cells, spectrum.cell).astype(np.int32)
        return cls(ArrowBuffer.of(columns), at, standing, confidence)

    @property
    def memory(self) -> NDArray[np.uint8]:
        """What is sent, after a head with the facts."""
        return self.arrow.content

    @property
    def n_bytes(self) -> int:
        """All that it takes."""
        return self.memory.nbytes + self.at.nbytes + self.standing.nbytes

    def write(self, spectrum: Spectrum, time: float, threads: int) -> None:
        """The state at a time (Unix seconds) by the spectrum that it was made for."""
        if self.conditioned:
            self.conditioned = False
            write_states(self.standing, self.confidence, self._columns)
        write_waves(spectrum, time, self.confidence, self.at, self._columns, threads)

    def write_given(self, spectrum: Spectrum, time: float, condition: Conditioning, threads: int) -> None:
        """The same given what was read last."""
        self.conditioned = True
        waves = Waves.of(spectrum, self.at, time)
        write_conditioned(waves, self.standing, condition, self.confidence, self._columns, threads)

    @property
    def _columns(self) -> StateColumns:
        columns = self.arrow.columns
        return StateColumns(columns["probability"], columns["state"], columns["verdict"].view(np.uint8))


def seen_columns(state: NDArray[np.uint8], time: NDArray[np.float64]) -> dict[str, Column]:
    """What was last seen of some cells and when, (n,) each: UNOBSERVED and NaN where never."""
    return {"observed": Nullable(state, state == UNOBSERVED), "observed_time": Nullable(time, np.isnan(time))}

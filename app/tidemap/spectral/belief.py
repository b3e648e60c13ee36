"""Belief: the state of cells as read by a sensor that errs, moved by every reading (DESIGN 2.8).

A reading says 1 with probability 1 - miss of an occupied state, false_alarm of a free one. The belief b that the state
is occupied moves by b ← bL₁ / (bL₁ + (1 - b)L₀) from the conditioned probability at that moment. That is the mixture of
both cases, s₀ = 1 and s₀ = 0, weighted by the belief before. Each case has an age of its own: the mean time that the
state has lasted if that is the case (assumed density filtering).
"""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tidemap.history.history import NEVER, UNOBSERVED
from tidemap.history.jit import kernel
from tidemap.history.sequences import Sequences
from tidemap.spectral.conditioning import MIN_PROBABILITY, Standing
from tidemap.spectral.detector import Detector
from tidemap.spectral.durations import log_kept_at
from tidemap.spectral.sensor import weighed

MAX_LASTED: Final = 1e6
"""The most that r / (1 - r) may be: no state is certain to have lasted."""
MIN_BELIEF: Final = 1e-6
AGE_UNIT: Final = 8
"""Ages are kept in eighths of a sample."""
MAX_AGE: Final = (2**16 - 1) / AGE_UNIT
NOT_HELD: Final = Standing()


@dataclass(frozen=True, slots=True, eq=False)
class Beliefs:
    """What is believed of some cells since they were read last, (n,) each; 20 bytes a cell.

    signed: float32, the probability that the state was occupied then, minus that (or -0.0) where the latest reading
    was free, NaN where there is none. sample: int64, of that reading. p: float32, the rhythm's probability of an
    occupied state then. age: (2, n) uint16, in eighths of a sample, how long the state had lasted if it was 0, or 1.
    """

    detector: Detector
    signed: NDArray[np.float32]
    sample: NDArray[np.int64]
    p: NDArray[np.float32]
    age: NDArray[np.uint16]

    @classmethod
    def none(cls, n_cells: int, detector: Detector) -> "Beliefs":
        """No reading yet."""
        return cls(
            detector,
            np.full(n_cells, np.nan, np.float32),
            np.full(n_cells, NEVER, np.int64),
            np.full(n_cells, np.nan, np.float32),
            np.zeros((2, n_cells), np.uint16),
        )

    @property
    def state(self) -> NDArray[np.uint8]:
        """(n,) uint8: what was read last, UNOBSERVED where nothing was."""
        return np.where(np.isnan(self.signed), np.uint8(UNOBSERVED), ~np.signbit(self.signed)).astype(np.uint8)

    @property
    def probability(self) -> NDArray[np.float32]:
        """(n,) float32: the belief that the state was occupied when it was read last, NaN where it was not."""
        return np.abs(self.signed)

    @property
    def nbytes(self) -> int:
        """The memory it takes."""
        return self.signed.nbytes + self.sample.nbytes + self.p.nbytes + self.age.nbytes

    def rows(self, rows: NDArray[np.int64]) -> "Beliefs":
        """Those of some rows, in any order; a copy."""
        age = np.take(self.age, rows, axis=1)
        return Beliefs(self.detector, self.signed[rows], self.sample[rows], self.p[rows], age)

    def part(self, rows: slice) -> "Beliefs":
        """Those of neighbouring rows, as far as that goes as views."""
        age = np.ascontiguousarray(self.age[:, rows])
        return Beliefs(self.detector, self.signed[rows], self.sample[rows], self.p[rows], age)

    def without(self, rows: NDArray[np.int64]) -> "Beliefs":
        """A copy in which nothing is believed of some rows."""
        signed = self.signed.copy()
        signed[rows] = np.nan
        return Beliefs(self.detector, signed, self.sample, self.p, self.age)

    def put(self, rows: NDArray[np.int64], other: "Beliefs") -> None:
        """In place: those of some rows."""
        self.signed[rows], self.sample[rows], self.p[rows] = other.signed, other.sample, other.p
        self.age[:, rows] = other.age

    def replaced(self, rows: NDArray[np.int64], other: "Beliefs") -> "Beliefs":
        """A copy with those of `other` in some rows."""
        copy = self.rows(np.arange(len(self.sample)))
        copy.put(rows, other)
        return copy

    def filtered(self, sequences: Sequences, p: NDArray[np.float32]) -> "Beliefs":
        """Moved by later readings of the same cells; p: the model's at every reading, NaN leaves it out.

        Nothing is held from one reading to the next: what comes after a hold may have changed at any time before.
        To filter some readings and then the others gives the same bits as to filter all at once.
        """
        moved = self.rows(np.arange(len(self.sample)))
        read = (sequences.offset, sequences.sample, sequences.state, self.unread(p))
        _filter(*read, *self._constants, moved.signed, moved.sample, moved.p, moved.age)
        return moved

    def traced(self, sequences: Sequences, p: NDArray[np.float32]) -> "Beliefs":
        """As `filtered`, but a row for every reading: what is believed of its cell after it."""
        every = self.rows(sequences.cell)
        read = (sequences.offset, sequences.sample, sequences.state, self.unread(p))
        _filter_each(*read, *self._constants, every.signed, every.sample, every.p, every.age)
        return every

    def condition(
        self,
        p: NDArray[np.float32],
        sample: NDArray[np.int64],
        standing: Standing = NOT_HELD,
        out: NDArray[np.float32] | None = None,
    ) -> NDArray[np.float32]:
        """The probability of the state, from p (n, m), that of readings of these cells in samples (m,), given those of
        the same sample or earlier ones.

        Written to `out` (n, m) where that is given.
        """
        out = np.empty(p.shape, np.float32) if out is None else out
        now = (self.signed, self.sample, self.p, self.age)
        _condition(self.unread(p), sample, (standing.hold, standing.limit), self._constants[1], *now, out)
        return out

    def ahead(self, p: NDArray[np.float32], sample: NDArray[np.int64], horizon: int, hold: int) -> NDArray[np.float32]:
        """The same of each row in a sample of its own; p and sample (n,). What is read stands until `horizon` samples
        before it."""
        out, now = np.empty(p.shape, np.float32), (self.signed, self.sample, self.p, self.age)
        _condition_each(self.unread(p), sample, horizon, hold, self._constants[1], *now, out)
        return out

    def unread(self, p: NDArray[np.float32]) -> NDArray[np.float32]:
        """The probability of the state where nothing was read, from p, that of readings."""
        return self.detector.sensor.state_probability(p).astype(np.float32)

    @property
    def _constants(self) -> tuple[tuple[float, float], NDArray[np.float64]]:
        return self.detector.sensor.bounded, self.detector.durations.log_kept


@kernel
def _filter(
    offset: NDArray[np.int64],
    read: NDArray[np.int64],
    state: NDArray[np.uint8],
    rhythm: NDArray[np.float32],
    rates: tuple[float, float],
    log_kept: NDArray[np.float64],
    signed: NDArray[np.float32],
    sample: NDArray[np.int64],
    p: NDArray[np.float32],
    age: NDArray[np.uint16],
) -> None:
    """In place: move what is believed of every cell by its readings; what is between them is rounded as it is kept."""
    for cell in range(offset.size - 1):
        for j in range(offset[cell], offset[cell + 1]):
            now = (signed[cell], sample[cell], p[cell], age[0, cell], age[1, cell])
            moved = _moved(now, read[j], state[j], rhythm[j], rates, log_kept)
            signed[cell], sample[cell], p[cell], age[0, cell], age[1, cell] = moved


@kernel
def _filter_each(
    offset: NDArray[np.int64],
    read: NDArray[np.int64],
    state: NDArray[np.uint8],
    rhythm: NDArray[np.float32],
    rates: tuple[float, float],
    log_kept: NDArray[np.float64],
    signed: NDArray[np.float32],
    sample: NDArray[np.int64],
    p: NDArray[np.float32],
    age: NDArray[np.uint16],
) -> None:
    """The same with a row for every reading, which begins as what was believed of its cell before all of them."""
    for cell in range(offset.size - 1):
        for j in range(offset[cell], offset[cell + 1]):
            before = j if j == offset[cell] else j - 1
            now = (signed[before], sample[before], p[before], age[0, before], age[1, before])
            moved = _moved(now, read[j], state[j], rhythm[j], rates, log_kept)
            signed[j], sample[j], p[j], age[0, j], age[1, j] = moved


@kernel
def _moved(
    now: tuple[float, int, float, int, int],
    read: int,
    state: int,
    rhythm: float,
    rates: tuple[float, float],
    log_kept: NDArray[np.float64],
) -> Any:
    """What is kept of a cell after a reading, from what was kept before it."""
    if np.isnan(rhythm):
        return now
    signed, sample, at_reading, free, occupied = now
    before, free_age, occupied_age = float(rhythm), 1.0, 1.0
    if not np.isnan(signed):
        kept = (abs(signed), sample, at_reading, free, occupied)
        before, free_age, occupied_age = _ahead(kept, sample, read, rhythm, log_kept)
    before = min(max(before, MIN_BELIEF), 1 - MIN_BELIEF)
    one, zero = weighed(before, state, rates)
    belief = np.float32(one / (one + zero))
    ages = np.rint(AGE_UNIT * min(free_age, MAX_AGE)), np.rint(AGE_UNIT * min(occupied_age, MAX_AGE))
    return belief if state else -belief, read, rhythm, np.uint16(ages[0]), np.uint16(ages[1])


@kernel
def _condition(
    rhythm: NDArray[np.float32],
    asked: NDArray[np.int64],
    standing: tuple[int, int],
    log_kept: NDArray[np.float64],
    signed: NDArray[np.float32],
    sample: NDArray[np.int64],
    at_reading: NDArray[np.float32],
    age: NDArray[np.uint16],
    out: NDArray[np.float32],
) -> None:
    """out (n, m): `_state` of every cell in every sample asked for."""
    for cell in range(signed.size):
        now = (signed[cell], sample[cell], at_reading[cell], age[0, cell], age[1, cell])
        for column in range(asked.size):
            out[cell, column] = _state(now, asked[column], standing, rhythm[cell, column], log_kept)


@kernel
def _condition_each(
    rhythm: NDArray[np.float32],
    asked: NDArray[np.int64],
    horizon: int,
    hold: int,
    log_kept: NDArray[np.float64],
    signed: NDArray[np.float32],
    sample: NDArray[np.int64],
    at_reading: NDArray[np.float32],
    age: NDArray[np.uint16],
    out: NDArray[np.float32],
) -> None:
    """out (n,): `_state` of every row in the sample asked for of it."""
    for row in range(signed.size):
        now = (signed[row], sample[row], at_reading[row], age[0, row], age[1, row])
        out[row] = _state(now, asked[row], (hold, asked[row] - horizon), rhythm[row], log_kept)


@kernel
def _state(
    now: tuple[float, int, float, int, int],
    asked: int,
    standing: tuple[int, int],
    rhythm: float,
    log_kept: NDArray[np.float64],
) -> Any:
    """The mixture of both cases; the rhythm itself before the reading and without one."""
    signed, sample, at_reading, free, occupied = now
    if np.isnan(signed) or asked < sample:
        return rhythm
    hold, limit = standing
    until = min(max(sample, min(sample + hold, limit)), asked)
    return np.float32(_ahead((abs(signed), sample, at_reading, free, occupied), until, asked, rhythm, log_kept)[0])


@kernel
def _ahead(
    now: tuple[float, int, float, int, int], until: int, asked: int, rhythm: float, log_kept: NDArray[np.float64]
) -> tuple[float, float, float]:
    """The probability of an occupied state in a later sample, and for how long it has lasted there if 0, or 1.

    What was read stands until `until`; rhythm: the probability of an occupied state in the sample without readings.
    """
    belief, sample, at_reading, free, occupied = now
    elapsed, held = asked - sample, until - sample
    free_age, occupied_age = free / AGE_UNIT, occupied / AGE_UNIT
    stays = _given(rhythm, at_reading, _lasted(log_kept[1], occupied_age + held, asked - until))
    comes = 1 - _given(1 - rhythm, 1 - at_reading, _lasted(log_kept[0], free_age + held, asked - until))
    one = belief * stays + (1 - belief) * comes
    zero = belief * (1 - stays) + (1 - belief) * (1 - comes)
    new_occupied = (belief * stays * (occupied_age + elapsed) + (1 - belief) * comes) / max(one, MIN_BELIEF)
    new_free = (belief * (1 - stays) + (1 - belief) * (1 - comes) * (free_age + elapsed)) / max(zero, MIN_BELIEF)
    return one, max(1.0, new_free), max(1.0, new_occupied)


@kernel
def _lasted(log_kept: NDArray[np.float64], age: float, delta: float) -> float:
    """r / (1 - r) of a state of some age, `delta` samples later."""
    kept = np.exp(log_kept_at(log_kept, age + delta) - log_kept_at(log_kept, age))
    return float(min(MAX_LASTED, kept / max(1 - kept, 1 / MAX_LASTED)))


@kernel
def _given(p: float, q: float, lasted: float) -> float:
    """The probability of the state that was read, as `conditioning.condition`: p and q are that state's."""
    own = min(max(p, MIN_PROBABILITY), 1 - MIN_PROBABILITY)
    likely = max(q, MIN_PROBABILITY)
    return float(own * (likely + lasted) / (likely + own * lasted))

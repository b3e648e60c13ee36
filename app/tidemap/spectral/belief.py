"""Belief: the state of cells as read by a sensor that errs, moved by every reading (DESIGN 2.8).

A reading says 1 with probability 1 - miss of an occupied state, false_alarm of a free one. The belief b that the state
is occupied moves by b ← bL₁ / (bL₁ + (1 - b)L₀) from the conditioned probability at that moment. That is the mixture of
both cases, s₀ = 1 and s₀ = 0, weighted by the belief before. Each case has an age of its own: the mean time that the
state has lasted if that is the case (assumed density filtering).
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tidemap.history.history import NEVER, UNOBSERVED
from tidemap.history.jit import kernel
from tidemap.history.sequences import Sequences
from tidemap.spectral.conditioning import MIN_PROBABILITY, Standing
from tidemap.spectral.durations import Durations, log_kept_at
from tidemap.spectral.sensor import Sensor, weighed

MAX_LASTED: Final = 1e6
"""The most that r / (1 - r) may be: no state is certain to have lasted."""
MIN_BELIEF: Final = 1e-6
AGE_UNIT: Final = 8
"""Ages are kept in eighths of a sample."""
MAX_AGE: Final = (2**16 - 1) / AGE_UNIT
NOT_HELD: Final = Standing()


@dataclass(frozen=True, slots=True, eq=False)
class Detector:
    """A sensor that errs, and how long the states last that it reads.

    readings: how many its rates were learned from, 0 where they were given or are what is believed. reason: where they
    come from, in words.
    """

    sensor: Sensor
    durations: Durations
    readings: int = 0
    reason: str = ""

    def as_dict(self) -> dict[str, Any]:
        """As plain JSON; the logarithms to six digits."""
        log_kept = self.durations.log_kept.round(6).tolist()
        return {**asdict(self.sensor), "log_kept": log_kept, "readings": self.readings, "reason": self.reason}

    @classmethod
    def from_dict(cls, value: Mapping[str, Any]) -> "Detector":
        """The inverse of `as_dict`. ValueError, TypeError or KeyError where it is none."""
        sensor = Sensor(value["miss"], value["false_alarm"])
        return cls(sensor, Durations(np.array(value["log_kept"], np.float64)), value["readings"], value["reason"])


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

    def filtered(self, sequences: Sequences, p: NDArray[np.float32], hold: int = 0) -> "Beliefs":
        """Moved by later readings of the same cells; p: the model's at every reading, NaN leaves it out.

        To filter some readings and then the others gives the same bits as to filter all at once.
        """
        moved = self.rows(np.arange(len(self.sample)))
        sensor, log_kept = self.detector.sensor, self.detector.durations.log_kept
        rhythm = sensor.state_probability(p).astype(np.float32)
        read = (sequences.offset, sequences.sample, sequences.state, rhythm)
        now = (moved.signed, moved.sample, moved.p, moved.age)
        _filter(*read, sensor.bounded, log_kept, hold, *now)
        return moved

    def condition(
        self,
        p: NDArray[np.float32],
        sample: NDArray[np.int64],
        standing: Standing = NOT_HELD,
        out: NDArray[np.float32] | None = None,
    ) -> NDArray[np.float32]:
        """p (n, m) of these cells in samples (m,), given the readings of the same sample or earlier ones.

        Written to `out` (n, m) where that is given.
        """
        out = np.empty(p.shape, np.float32) if out is None else out
        sensor, log_kept = self.detector.sensor, self.detector.durations.log_kept
        rhythm = sensor.state_probability(p).astype(np.float32)
        now = (self.signed, self.sample, self.p, self.age)
        _condition(p, rhythm, sample, (standing.hold, standing.limit), log_kept, *now, out)
        return out


@kernel
def _filter(
    offset: NDArray[np.int64],
    read: NDArray[np.int64],
    state: NDArray[np.uint8],
    rhythm: NDArray[np.float32],
    rates: tuple[float, float],
    log_kept: NDArray[np.float64],
    hold: int,
    signed: NDArray[np.float32],
    sample: NDArray[np.int64],
    p: NDArray[np.float32],
    age: NDArray[np.uint16],
) -> None:
    """In place: move what is believed of every cell by its readings; what is between them is rounded as it is kept."""
    for cell in range(offset.size - 1):
        for j in range(offset[cell], offset[cell + 1]):
            if np.isnan(rhythm[j]):
                continue
            before, free_age, occupied_age = float(rhythm[j]), 1.0, 1.0
            if not np.isnan(signed[cell]):
                until = min(sample[cell] + hold, read[j])
                now = (abs(signed[cell]), sample[cell], p[cell], age[0, cell], age[1, cell])
                before, free_age, occupied_age = _ahead(now, until, read[j], rhythm[j], log_kept)
            before = min(max(before, MIN_BELIEF), 1 - MIN_BELIEF)
            occupied, free = weighed(before, state[j], rates)
            belief = np.float32(occupied / (occupied + free))
            signed[cell] = belief if state[j] else -belief
            sample[cell], p[cell] = read[j], rhythm[j]
            age[0, cell] = np.uint16(np.rint(AGE_UNIT * min(free_age, MAX_AGE)))
            age[1, cell] = np.uint16(np.rint(AGE_UNIT * min(occupied_age, MAX_AGE)))


@kernel
def _condition(
    p: NDArray[np.float32],
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
    """out (n, m): the mixture of both cases; p (n, m) itself before the reading and without one."""
    hold, limit = standing
    for cell in range(signed.size):
        for column in range(asked.size):
            if np.isnan(signed[cell]) or asked[column] < sample[cell]:
                out[cell, column] = p[cell, column]
                continue
            until = min(max(sample[cell], min(sample[cell] + hold, limit)), asked[column])
            now = (abs(signed[cell]), sample[cell], at_reading[cell], age[0, cell], age[1, cell])
            ahead = _ahead(now, until, asked[column], rhythm[cell, column], log_kept)
            out[cell, column] = np.float32(ahead[0])


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

"""Conditioning: the state at a time, given the latest reading of a cell (DESIGN 2.8).

Read backwards from t: with probability r nothing was redrawn since the latest reading s0 at t0, so s(t) = s0;
otherwise s0 came from the rhythm at t0. Bayes gives odds(t | s0 = 1) = odds p(t) · (1 + g) and
odds(t | s0 = 0) = odds p(t) / (1 + g) with g = r / ((1 - r) · q), where q is p(t0) if s0 = 1, else 1 - p(t0).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tidemap.history.history import UNOBSERVED
from tidemap.history.jit import kernel
from tidemap.spectral.correction import NO_CORRECTION, LastingCorrection, correction_at

MAX_KEPT: Final = 0.9995
"""The most that r may be: no reading is certain for ever."""
MAX_LASTED: Final = MAX_KEPT / (1 - MAX_KEPT)
"""The same of r / (1 - r)."""
MIN_PROBABILITY: Final = 1e-4
"""The least that the rhythm may believe of a state that was read, and of one that is asked for."""
BLOCK: Final = 1 << 12
"""Cells that are conditioned at a time."""
MAX_SLOTS: Final = 1 << 10
"""Samples with an age whose persistence is known at a time; a power of two."""
HASH_FACTORS: Final = (0x9E3779B1, 0x85EBCA77)
HASH_SHIFT: Final = 20
"""Factors and a shift under which samples and ages near each other get slots of their own."""


@dataclass(frozen=True, slots=True)
class Persistence:
    """How long states last: r(δ, a) = ν ((τ + κa) / (τ + κa + δ))^α, a mixture of exponentials, and a correction.

    nu: the share of readings that are no flicker, in (0, 1); tau_s in seconds; alpha, kappa: without unit. A state that
    has lasted long lasts longer by κ times that. correction: what is added to ln(r / (1 - r)), after which r is
    `MAX_KEPT` at most. ValueError where one of them is out of range.
    """

    nu: float = float(1 / (1 + np.exp(-2.0)))
    tau_s: float = 1800.0
    alpha: float = 1.0
    kappa: float = float(np.exp(-2.0))
    correction: LastingCorrection = NO_CORRECTION

    def __post_init__(self) -> None:
        if not (0 < self.nu < 1 and self.tau_s > 0 and self.alpha > 0 and self.kappa >= 0):
            raise ValueError(f"nu lies between 0 and 1, the others are positive, not {self}")

    def kept(self, state: ArrayLike, delta_s: ArrayLike, age_s: ArrayLike) -> NDArray[np.float64]:
        """r: the probability that nothing was redrawn for `delta_s` seconds after a state had lasted `age_s`.

        >>> Persistence(nu=0.5, tau_s=60.0, alpha=1.0, kappa=0.0).kept(1, [0.0, 60.0, 180.0], 5.0).round(4).tolist()
        [0.5, 0.25, 0.125]
        """
        scale = self.tau_s + self.kappa * np.asarray(age_s, np.float64)
        r = self.nu * (scale / (scale + np.asarray(delta_s, np.float64))) ** self.alpha
        lasted = r / (1 - r) * np.exp(self.correction.at(state, delta_s, age_s))
        return np.asarray(np.minimum(MAX_KEPT, lasted / (1 + lasted)))

    def half_life_s(self, age_s: float) -> float:
        """How long until half of what a reading says of later states is gone, after a state had lasted `age_s`.

        Without the correction.

        >>> Persistence(nu=0.5, tau_s=60.0, alpha=1.0, kappa=0.0).half_life_s(5.0)
        60.0
        """
        return float((self.tau_s + self.kappa * age_s) * np.expm1(np.log(2) / self.alpha))

    def as_dict(self) -> dict[str, Any]:
        """As plain JSON."""
        plain: dict[str, Any] = {"nu": self.nu, "tau_s": self.tau_s, "alpha": self.alpha, "kappa": self.kappa}
        if self.correction is not NO_CORRECTION:
            plain["correction"] = [self.correction.interval_s, self.correction.value.tolist()]
        return plain

    @classmethod
    def from_dict(cls, value: Mapping[str, Any]) -> "Persistence":
        """The inverse of `as_dict`. ValueError, TypeError or KeyError where it is none."""
        formula = {name: value[name] for name in ("nu", "tau_s", "alpha", "kappa")}
        if "correction" not in value:
            return cls(**formula)
        interval_s, table = value["correction"]
        return cls(**formula, correction=LastingCorrection(interval_s, np.array(table, np.float64)))


UNLEARNED: Final = Persistence()
"""What is believed without having learned."""


@dataclass(frozen=True, slots=True)
class Standing:
    """How readings stand: for `hold` samples after their own, but not after sample `limit`."""

    hold: int = 0
    limit: int = 0


EVIDENCE_BYTES: Final = 17
"""Of each cell."""


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """The latest reading of some cells, (n,) each; `EVIDENCE_BYTES` a cell.

    state: uint8, UNOBSERVED where there is none. sample: int64. age: uint32, how many samples it had lasted, its own
    included. q: float32, the model's probability of it when it was read.
    """

    state: NDArray[np.uint8]
    sample: NDArray[np.int64]
    age: NDArray[np.uint32]
    q: NDArray[np.float32]

    @property
    def nbytes(self) -> int:
        """The memory it takes."""
        return sum(each.nbytes for each in self._columns())

    def rows(self, rows: NDArray[np.int64]) -> "Evidence":
        """That of some rows, in any order; a copy."""
        return Evidence(self.state[rows], self.sample[rows], self.age[rows], self.q[rows])

    def part(self, rows: slice) -> "Evidence":
        """That of neighbouring rows, as views."""
        return Evidence(self.state[rows], self.sample[rows], self.age[rows], self.q[rows])

    def without(self, rows: NDArray[np.int64]) -> "Evidence":
        """A copy in which some rows say nothing."""
        state = self.state.copy()
        state[rows] = UNOBSERVED
        return Evidence(state, self.sample, self.age, self.q)

    def replaced(self, rows: NDArray[np.int64], other: "Evidence") -> "Evidence":
        """A copy with that of `other` in some rows."""
        copy = Evidence(self.state.copy(), self.sample.copy(), self.age.copy(), self.q.copy())
        for mine, new in zip(copy._columns(), other._columns(), strict=True):
            mine[rows] = new
        return copy

    def unread(self, p: NDArray[np.float32]) -> NDArray[np.float32]:
        """What `condition` says where nothing was read: the model's p itself."""
        return p

    def _columns(self) -> tuple[NDArray[np.generic], ...]:
        return self.state, self.sample, self.age, self.q

    def condition(
        self,
        p: NDArray[np.float32],
        sample: NDArray[np.int64],
        interval_s: float,
        persistence: Persistence,
        standing: Standing = Standing(),
        out: NDArray[np.float32] | None = None,
    ) -> NDArray[np.float32]:
        """p (n, m) of these cells in samples (m,), given the readings of the same sample or earlier ones.

        Written to `out` where that is given: (n, m) in Fortran order.
        """
        found = np.empty(p.shape[::-1], np.float32) if out is None else out.T
        learned = (persistence.nu, persistence.tau_s, persistence.alpha, persistence.kappa)
        scale = (interval_s, standing.hold, standing.limit)
        read = (self.state, self.sample, self.age, self.q)
        correction = persistence.correction.value
        _condition(np.ascontiguousarray(p.T), *read, np.ascontiguousarray(sample), scale, learned, correction, found)
        return found.T


def condition(p: ArrayLike, q: ArrayLike, state: ArrayLike, kept: ArrayLike) -> NDArray[np.float64]:
    """p(t) given the latest reading, of the shape of the arguments together; without exp and log.

    p: the model's p(t); q: the model's probability of what was read, when it was read; state: 0 or 1; kept: r. r = 0
    gives p, r = 1 the reading.

    >>> condition([0.5, 0.5, 0.02], [0.5, 0.5, 0.02], [1, 0, 1], [0.5, 0.5, 0.5]).round(3).tolist()
    [0.75, 0.25, 0.51]
    """
    bounded = np.clip(np.asarray(p, np.float64), MIN_PROBABILITY, 1 - MIN_PROBABILITY)
    likely = np.maximum(np.asarray(q, np.float64), MIN_PROBABILITY)
    r = np.asarray(kept, np.float64)
    lasted = r / (1 - r)
    occupied = np.asarray(state) != 0
    own = np.where(occupied, bounded, 1 - bounded)
    given = own * (likely + lasted) / (likely + own * lasted)
    return np.asarray(np.where(occupied, given, 1 - given))


@kernel
def _condition(
    p: NDArray[np.float32],
    state: NDArray[np.uint8],
    read: NDArray[np.int64],
    age: NDArray[np.uint32],
    q: NDArray[np.float32],
    asked: NDArray[np.int64],
    scale: tuple[float, int, int],
    learned: tuple[float, float, float, float],
    correction: NDArray[np.float64],
    out: NDArray[np.float32],
) -> None:
    """out (m, n): `condition` of p (m, n); a block of cells at a time, without branches, several at once.

    An index without a sign cannot count from the end: to look for that would take twice as long.
    """
    lasted = np.empty(min(BLOCK, state.size), np.float32)
    n_slots = 1
    while 2 * n_slots <= min(MAX_SLOTS, state.size):
        n_slots *= 2
    slots = (np.empty(n_slots, np.int64), np.empty(n_slots, np.int64), np.empty((n_slots, 2), np.float32))
    how = (scale, learned, correction)
    for row in range(asked.size):
        slots[1][:] = -1
        for first in range(0, state.size, BLOCK):
            last = min(first + BLOCK, state.size)
            _fill_lasted(state[first:last], read[first:last], age[first:last], asked[row], how, slots, lasted)
            for i in range(np.uint64(first), np.uint64(last)):
                out[row, i] = _conditioned(p[row, i], state[i], q[i], lasted[i - np.uint64(first)])


@kernel
def _conditioned(p: Any, state: Any, q: Any, lasted: Any) -> Any:
    """The one formula of `condition`, of one cell in float32; p itself where nothing was read before."""
    least, most, one = np.float32(MIN_PROBABILITY), np.float32(1 - MIN_PROBABILITY), np.float32(1)
    bounded = least if p < least else (most if p > most else p)
    likely = least if q < least else q
    own = bounded if state == 1 else one - bounded
    given = own * (likely + lasted) / (likely + own * lasted)
    known = given if state == 1 else one - given
    return p if (state == UNOBSERVED) | (lasted < np.float32(0)) else known


@kernel
def _fill_lasted(
    state: NDArray[np.uint8],
    read: NDArray[np.int64],
    age: NDArray[np.uint32],
    asked: int,
    how: tuple[tuple[float, int, int], tuple[float, float, float, float], NDArray[np.float64]],
    slots: tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float32]],
    out: NDArray[np.float32],
) -> None:
    """out (n,): `_lasted` of every reading, -1 of those that are later than what is asked for.

    Many are read alike, neighbours above all: slots hold what is known of some samples and ages, of state 0 and 1.
    """
    known_read, known_age, known = slots
    scale, learned, correction = how
    last_read, last_age, free, occupied = np.int64(0), np.int64(-1), np.float32(-1), np.float32(-1)
    for i in range(read.size):
        if read[i] != last_read or age[i] != last_age:
            last_read, last_age = read[i], np.int64(age[i])
            slot = ((last_read * HASH_FACTORS[0] + last_age * HASH_FACTORS[1]) >> HASH_SHIFT) & (known_read.size - 1)
            if known_age[slot] != last_age or known_read[slot] != last_read:
                known_read[slot], known_age[slot] = last_read, last_age
                for each in range(2):
                    later = asked < last_read
                    lasted = -1.0 if later else _lasted(each, last_read, last_age, asked, scale, learned, correction)
                    known[slot, each] = lasted
            free, occupied = known[slot, 0], known[slot, 1]
        out[i] = occupied if state[i] == 1 else free


@kernel
def _lasted(
    state: Any,
    read: int,
    age: Any,
    asked: int,
    scale: tuple[float, int, int],
    learned: tuple[float, float, float, float],
    correction: NDArray[np.float64],
) -> float:
    """r / (1 - r) of a reading of a state in a sample that is asked for."""
    interval_s, hold, limit = scale
    nu, tau_s, alpha, kappa = learned
    until = max(read, min(read + hold, limit))
    lived, apart = age + until - read, max(0, asked - until)
    span = tau_s + kappa * lived * interval_s
    kept = nu * (span / (span + apart * interval_s)) ** alpha
    return float(min(MAX_LASTED, kept / (1 - kept) * np.exp(correction_at(correction, state, apart, lived))))
